from __future__ import annotations

import numpy as np
from pydantic import NonNegativeFloat

from pointkit.geometry.cloud import Floats
from virtual_lidar.errors.model import ERROR_MODELS, Hits
from virtual_lidar.errors.vlp16 import Vlp16

CODE = ("virtual_lidar.errors.vlp16",)


@ERROR_MODELS.register("vlp16_incidence")
class Vlp16Incidence(Vlp16):
    """Error model `Vlp16` with more ray noise at slanting incidence (thesis, section 5.5.4).

    The scale of a ray's noise is ``ray_sigma_m + (incidence_factor * theta)^2`` for the incidence
    theta, rad, which is 0 for a ray perpendicular to the surface. The default factor adds 6.2 mm at
    45 degrees, 11.0 mm at 60 degrees and 24.7 mm at grazing incidence.
    """

    incidence_factor: NonNegativeFloat = 0.1
    """Square root of the added noise per rad, sqrt(m) / rad."""

    def ray_scale(self, hits: Hits) -> Floats | float:
        scale = hits.incidence * self.incidence_factor
        scale *= scale
        scale += self.ray_sigma_m
        return np.nan_to_num(scale, copy=False)

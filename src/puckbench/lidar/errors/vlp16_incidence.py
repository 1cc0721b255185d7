"""Range noise of the VLP-16 that grows with the incidence angle (thesis section 5.5.4)."""

from __future__ import annotations

import numpy as np
from pydantic import NonNegativeFloat

from puckbench.geometry.cloud import Floats
from puckbench.lidar.errors.model import Hits
from puckbench.lidar.errors.registry import ERROR_MODELS
from puckbench.lidar.errors.vlp16 import Vlp16


@ERROR_MODELS.register("vlp16_incidence")
class Vlp16Incidence(Vlp16):
    """As `Vlp16`, and the noise of a ray grows with the angle of incidence (thesis section 5.5.4).

    The sigma of a ray is ``ray_sigma_m + (incidence_factor * theta)^2`` metres, theta being the
    angle between ray and surface normal in radians: 0 adds nothing, 45 degrees 6.2 mm, 60 degrees
    11.0 mm and a grazing ray 24.7 mm.

    Parameters
    ----------
    incidence_factor
        Root of metres per radian.
    """

    title, colour = "Incidence", "#E69F00"

    incidence_factor: NonNegativeFloat = 0.1

    def ray_scale(self, hits: Hits) -> Floats | float:
        """Sigma of each ray, m, in the shape of ``hits.distance``."""
        scale = hits.incidence * self.incidence_factor
        scale *= scale
        scale += self.ray_sigma_m
        return np.nan_to_num(scale, copy=False)

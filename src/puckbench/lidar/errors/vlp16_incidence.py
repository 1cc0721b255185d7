"""Range noise of the VLP-16 that grows with the incidence angle (thesis section 5.5.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.lidar.errors.model import Hits
from puckbench.lidar.errors.vlp16 import Vlp16
from puckbench.lidar.options import check_at_least


@dataclass(frozen=True)
class Vlp16Incidence(Vlp16):
    """As `Vlp16`, with ``ray_sigma_m + (incidence_factor * theta)^2`` metres as a ray's sigma.

    theta is the angle between ray and surface normal in radians: 0 adds nothing, 45 degrees 6.2 mm,
    60 degrees 11.0 mm and a grazing ray 24.7 mm.
    """

    incidence_factor: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        check_at_least(self, 0, "incidence_factor")

    def ray_scale(self, hits: Hits) -> Floats | float:
        """Sigma of each ray, m, in the shape of ``hits.distance``."""
        scale = hits.incidence * self.incidence_factor
        scale *= scale
        scale += self.ray_sigma_m
        return np.nan_to_num(scale, copy=False)

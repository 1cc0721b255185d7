from __future__ import annotations

from pydantic import NonNegativeFloat

from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensor import Sensor
from virtual_lidar.errors.model import ERROR_MODELS, Distribution, Draws, Hits, standard_noise
from virtual_lidar.errors.vlp16 import Vlp16

CODE = ("virtual_lidar.errors.vlp16",)


@ERROR_MODELS.register("surface_normal")
class SurfaceNormal(Vlp16):
    """Error model that moves measured points along the true surface normal; not in the thesis.

    On a plane the points then scatter by `normal_sigma_m` at any incidence, as those of the
    thesis's recorded wall and floor do (0.014 m). Noise along the ray instead scatters them in
    proportion to the cosine of the incidence; this noise of `Vlp16` is 0 by default.
    """

    bias_sigma_m: NonNegativeFloat = 0.0
    ray_sigma_m: NonNegativeFloat = 0.0
    normal_sigma_m: NonNegativeFloat = 0.014
    """Scale of the noise along the normal."""
    normal_distribution: Distribution = "gaussian"
    """``gaussian``, or ``laplace`` with b = `normal_sigma_m`."""

    def lift_points(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        stream, shape = draws.running("normal"), hits.distance.shape
        return standard_noise(stream, shape, self.normal_distribution) * self.normal_sigma_m

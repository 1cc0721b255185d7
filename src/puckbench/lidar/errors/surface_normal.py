from __future__ import annotations

from pydantic import NonNegativeFloat

from puckbench.geometry.cloud import Floats
from puckbench.lidar.errors.model import Draws, Hits
from puckbench.lidar.errors.noise import Distribution, standard_noise
from puckbench.lidar.errors.registry import ERROR_MODELS
from puckbench.lidar.errors.vlp16 import Vlp16
from puckbench.lidar.sensor import Sensor


@ERROR_MODELS.register("surface_normal")
class SurfaceNormal(Vlp16):
    """Displaces measured points along the true surface normal, which the thesis does not test.

    Plane residuals have the scale `normal_sigma_m` at any incidence, like those of the recorded
    wall and floor (0.014 m); noise along the ray would give residuals proportional to the cosine of
    the incidence angle. The noise of `Vlp16` along the ray can be added; its default is 0 here.
    """

    title, colour = "Surface normal", "#882255"

    bias_sigma_m: NonNegativeFloat = 0.0
    ray_sigma_m: NonNegativeFloat = 0.0
    normal_sigma_m: NonNegativeFloat = 0.014
    """Scale of the noise along the normal."""
    normal_distribution: Distribution = "gaussian"
    """``gaussian`` or ``laplace``, whose b is `normal_sigma_m`."""

    def lift_points(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        stream, shape = draws.running("normal"), hits.distance.shape
        return standard_noise(stream, shape, self.normal_distribution) * self.normal_sigma_m

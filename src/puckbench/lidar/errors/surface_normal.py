"""Noise along the normal of the surface, which the thesis proposed and did not try."""

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
    """A measured point is off its surface by noise along the true normal, not along the ray.

    So plane residuals have the sigma `normal_sigma_m` at any incidence, as the real wall and floor
    have (0.014 m), where noise along the ray makes them shrink with the cosine. The noise along
    the ray of `Vlp16` can be added; it is off here. The thesis proposes this model and does not
    try it.

    Parameters
    ----------
    normal_sigma_m
        Scale of the noise along the normal, metres.
    normal_distribution
        ``"gaussian"`` or ``"laplace"``.
    """

    title, colour = "Surface normal", "#882255"

    bias_sigma_m: NonNegativeFloat = 0.0
    ray_sigma_m: NonNegativeFloat = 0.0
    normal_sigma_m: NonNegativeFloat = 0.014
    normal_distribution: Distribution = "gaussian"

    def lift_points(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        """Noise along the normal, m."""
        stream, shape = draws.running("normal"), hits.distance.shape
        return standard_noise(stream, shape, self.normal_distribution) * self.normal_sigma_m

"""Range noise of the VLP-16: a bias per laser and noise per ray (thesis equation 5.4)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import NonNegativeFloat

from puckbench.geometry.cloud import Floats
from puckbench.lidar.errors.model import Draws, ErrorModel, Hits
from puckbench.lidar.errors.noise import Distribution, standard_noise
from puckbench.lidar.errors.registry import ERROR_MODELS
from puckbench.lidar.sensor import Sensor


@ERROR_MODELS.register("vlp16")
class Vlp16(ErrorModel):
    """Each range has a bias of its laser and noise of its ray (thesis equation 5.4).

    ``d + bias[laser] + N(ray_mean_m, ray_sigma_m)`` with ``bias ~ N(0, bias_sigma_m)``. The
    default sigmas are those of the thesis's section 5.4 and its code; Table 5.1 prints others.

    Parameters
    ----------
    bias_sigma_m, ray_sigma_m
        Scales of the bias and of the ray's noise, metres.
    bias_redrawn
        ``"frame"``: at the start of every frame, as BlenSor's range scan does, which makes the
        streaks of Figures 5.6-5.9. ``"scan"``: kept for the whole scan.
    bias_distribution, ray_distribution
        ``"gaussian"``, or ``"laplace"``, whose b is then the sigma given; BlenSor offers Laplace
        for the bias only.
    ray_mean_m
        Mean of the ray's noise, metres.
    """

    title, colour = "VLP-16", "#0072B2"

    bias_sigma_m: NonNegativeFloat = 0.014
    ray_sigma_m: NonNegativeFloat = 0.010
    bias_redrawn: Literal["frame", "scan"] = "frame"
    bias_distribution: Distribution = "gaussian"
    ray_distribution: Distribution = "gaussian"
    ray_mean_m: float = 0.0

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        """True distance plus the bias of its laser plus the noise of its ray."""
        noisy = standard_noise(draws.running("ray"), hits.distance.shape, self.ray_distribution)
        noisy *= self.ray_scale(hits)
        noisy += self.ray_mean_m + self._bias(len(hits.distance), sensor, draws)[:, None, :]
        noisy += hits.distance
        return noisy

    def ray_scale(self, hits: Hits) -> Floats | float:
        """Scale of each ray's noise, m, finite for a miss too; one number for all rays here."""
        return self.ray_sigma_m

    def _bias(self, frames: int, sensor: Sensor, draws: Draws) -> Floats:
        """Bias of each laser in each frame, (frames, lasers)."""
        if self.bias_redrawn == "scan":
            lasers = (sensor.lasers,)
            bias = standard_noise(draws.fixed("bias"), lasers, self.bias_distribution)
            return np.broadcast_to(bias * self.bias_sigma_m, (frames, sensor.lasers))
        shape = (frames, sensor.lasers)
        bias = standard_noise(draws.running("bias"), shape, self.bias_distribution)
        return bias * self.bias_sigma_m

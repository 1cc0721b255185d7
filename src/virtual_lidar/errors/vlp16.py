from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import NonNegativeFloat

from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensor import Sensor
from virtual_lidar.errors.model import Draws, ErrorModel, Hits
from virtual_lidar.errors.noise import Distribution, standard_noise
from virtual_lidar.errors.registry import ERROR_MODELS


@ERROR_MODELS.register("vlp16")
class Vlp16(ErrorModel):
    """Range noise with a bias for each laser and independent noise for each ray (thesis, eq. 5.4).

    A measured range is ``d + bias[laser] + N(ray_mean_m, ray_sigma_m)`` with ``bias ~ N(0,
    bias_sigma_m)``. The default sigmas are those of the thesis's section 5.4 and code;
    `Vlp16Table51` has the sigmas of Table 5.1.
    """

    title, colour = "VLP-16", "#113388"

    bias_sigma_m: NonNegativeFloat = 0.014
    """Scale of a laser's bias."""
    ray_sigma_m: NonNegativeFloat = 0.010
    """Scale of a ray's noise."""
    bias_redrawn: Literal["frame", "scan"] = "frame"
    """``frame``: biases are drawn for every frame, as in BlenSor, which causes the streaks of the
    thesis's Figures 5.6-5.9. ``scan``: biases are constant in a scan."""
    bias_distribution: Distribution = "gaussian"
    """``gaussian``, or ``laplace`` with b = sigma; BlenSor offers ``laplace`` for the bias only."""
    ray_distribution: Distribution = "gaussian"
    """``gaussian``, or ``laplace`` with b = sigma."""
    ray_mean_m: float = 0.0
    """Mean of a ray's noise."""

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        noisy = standard_noise(draws.running("ray"), hits.distance.shape, self.ray_distribution)
        noisy *= self.ray_scale(hits)
        noisy += self.ray_mean_m + self._bias(len(hits.distance), sensor, draws)[:, None, :]
        noisy += hits.distance
        return noisy

    def ray_scale(self, hits: Hits) -> Floats | float:
        """Return the noise scale, m, of each ray or one for all rays; finite even for a miss."""
        return self.ray_sigma_m

    def _bias(self, frames: int, sensor: Sensor, draws: Draws) -> Floats:
        if self.bias_redrawn == "scan":
            lasers = (sensor.lasers,)
            bias = standard_noise(draws.fixed("bias"), lasers, self.bias_distribution)
            return np.broadcast_to(bias * self.bias_sigma_m, (frames, sensor.lasers))
        shape = (frames, sensor.lasers)
        bias = standard_noise(draws.running("bias"), shape, self.bias_distribution)
        return bias * self.bias_sigma_m

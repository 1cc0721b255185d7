"""Range noise of the VLP-16: a bias per laser and noise per ray (thesis equation 5.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.lidar.errors.model import Draws, Hits
from puckbench.lidar.errors.noise import check_distributions, standard_noise
from puckbench.lidar.options import check_at_least
from puckbench.lidar.sensor import Sensor
from puckbench.lidar.sweep import Rays


@dataclass(frozen=True)
class Vlp16:
    """``d + bias[laser] + N(ray_mean_m, ray_sigma_m)`` with ``bias ~ N(0, bias_sigma_m)``.

    The biases are redrawn at the start of every frame (``bias_redrawn="frame"``, as BlenSor's
    range scan does, which makes the streaks of Figures 5.6-5.9) or kept for the whole scan
    (``"scan"``). The default sigmas are those of the thesis's section 5.4 and its code; Table 5.1
    prints others. Either noise is ``"gaussian"`` or ``"laplace"``, whose b is then the sigma given;
    BlenSor offers Laplace for the bias only.
    """

    bias_sigma_m: float = 0.014
    ray_sigma_m: float = 0.010
    bias_redrawn: str = "frame"
    bias_distribution: str = "gaussian"
    ray_distribution: str = "gaussian"
    ray_mean_m: float = 0.0

    def __post_init__(self) -> None:
        check_at_least(self, 0, "bias_sigma_m", "ray_sigma_m")
        check_distributions(self, "bias_distribution", "ray_distribution")
        if self.bias_redrawn not in {"frame", "scan"}:
            raise InputError(
                f"bias_redrawn is {self.bias_redrawn!r}, but must be 'frame' or 'scan'"
            )

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        """The nominal rays."""
        return rays

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

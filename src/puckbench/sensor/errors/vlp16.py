"""Range noise of the VLP-16: a bias per laser and Gaussian noise per ray (thesis equation 5.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from puckbench.cloud import Floats
from puckbench.errors import InputError
from puckbench.sensor.errors.model import Draws, Hits
from puckbench.sensor.options import check_at_least
from puckbench.sensor.sensor import Sensor
from puckbench.sensor.sweep import Rays


@dataclass(frozen=True)
class Vlp16:
    """``d + bias[laser] + N(0, ray_sigma_m)`` with ``bias ~ N(0, bias_sigma_m)``.

    The biases are redrawn at the start of every frame (``bias_redrawn="frame"``, as BlenSor's
    range scan does, which makes the streaks of Figures 5.6-5.9) or kept for the whole scan
    (``"scan"``). The default sigmas are those of the thesis's section 5.4 and its code; Table 5.1
    prints others.
    """

    bias_sigma_m: float = 0.014
    ray_sigma_m: float = 0.010
    bias_redrawn: str = "frame"

    def __post_init__(self) -> None:
        check_at_least(self, 0, "bias_sigma_m", "ray_sigma_m")
        if self.bias_redrawn not in {"frame", "scan"}:
            raise InputError(
                f"bias_redrawn is {self.bias_redrawn!r}, but must be 'frame' or 'scan'"
            )

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        """The nominal rays."""
        return rays

    def perturb_ranges(self, hits: Hits, sensor: Sensor, draws: Draws) -> Floats:
        """True distance plus the bias of its laser plus the noise of its ray."""
        noisy = draws.running("ray").standard_normal(hits.distance.shape)
        noisy *= self.ray_sigma_m
        noisy += self._bias(len(hits.distance), sensor, draws)[:, None, :]
        noisy += hits.distance
        return noisy

    def _bias(self, frames: int, sensor: Sensor, draws: Draws) -> Floats:
        """Bias of each laser in each frame, (frames, lasers)."""
        if self.bias_redrawn == "scan":
            bias = draws.fixed("bias").standard_normal(sensor.lasers)
            return np.broadcast_to(bias * self.bias_sigma_m, (frames, sensor.lasers))
        return draws.running("bias").standard_normal((frames, sensor.lasers)) * self.bias_sigma_m

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import NonNegativeFloat

from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensor import Sensor
from virtual_lidar.errors.model import (
    ERROR_MODELS,
    Distribution,
    Draws,
    ErrorModel,
    Hits,
    standard_noise,
)


@ERROR_MODELS.register("vlp16")
class Vlp16(ErrorModel):
    """Error model of the thesis (equation 5.4): a bias of each laser, and noise of each ray.

    The measured range is ``d + bias + noise`` for the true range d. The bias, which all returns of
    a laser share, is drawn from ``N(0, bias_sigma_m)``, the noise of each return from
    ``N(ray_mean_m, ray_sigma_m)``. The default sigmas are those of the thesis's section 5.4 and
    code; the variant ``vlp16_table51`` has those of its Table 5.1.
    """

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
        """Return the scale of the noise of each ray, m.

        The result is one number for all rays, or an array in the shape of ``hits.distance``. Such
        an array is finite even for rays that hit nothing.
        """
        return self.ray_sigma_m

    def _bias(self, frames: int, sensor: Sensor, draws: Draws) -> Floats:
        if self.bias_redrawn == "scan":
            lasers = (sensor.lasers,)
            bias = standard_noise(draws.fixed("bias"), lasers, self.bias_distribution)
            return np.broadcast_to(bias * self.bias_sigma_m, (frames, sensor.lasers))
        shape = (frames, sensor.lasers)
        bias = standard_noise(draws.running("bias"), shape, self.bias_distribution)
        return bias * self.bias_sigma_m


class BeamOfWidth(Vlp16):
    """Base class of variants of `Vlp16` whose beams are wider than a ray."""

    yaw_width_deg: NonNegativeFloat | None = None
    """Full horizontal width of a beam; by default the sensor's divergence."""
    pitch_width_deg: NonNegativeFloat | None = None
    """Full vertical width of a beam; by default the sensor's divergence."""

    def beam_widths_deg(self, sensor: Sensor) -> tuple[float, float]:
        """Return the full horizontal and vertical width of a beam, degrees."""
        yaw, pitch = self.yaw_width_deg, self.pitch_width_deg
        return (
            sensor.divergence_horizontal_deg if yaw is None else yaw,
            sensor.divergence_vertical_deg if pitch is None else pitch,
        )

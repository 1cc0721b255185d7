"""Range noise of the VLP-16 with beam divergence: the error model that the thesis chose (5.5.3)."""

from __future__ import annotations

from typing import Literal

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.lidar.errors.beam import BeamOfWidth
from puckbench.lidar.errors.model import Draws
from puckbench.lidar.errors.registry import ERROR_MODELS
from puckbench.lidar.sensor import Sensor
from puckbench.lidar.sweep import Rays


@ERROR_MODELS.register("vlp16_divergence")
class Vlp16Divergence(BeamOfWidth):
    """As `Vlp16`, and each ray is first turned at random within the beam (thesis section 5.5.3).

    Yaw and pitch change by uniform numbers within half the beam's width. The reported yaw and
    pitch stay nominal.

    Parameters
    ----------
    returns_along
        ``"fired"`` puts a noisy point on the ray that was fired, as BlenSor does and the thesis
        ran. Such a point leaves its surface by range noise alone, so that divergence cannot widen
        plane residuals, whatever the distance. ``"nominal"`` puts the measured distance on the
        nominal ray, as a real sensor does, which knows no other direction.
    """

    title, colour = "Beam divergence", "#009E73"

    returns_along: Literal["fired", "nominal"] = "fired"

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        """Rays turned within the beam."""
        yaw_width, pitch_width = self.beam_widths_deg(sensor)
        yaw = rays.yaw + _uniform("beam yaw", yaw_width, rays.yaw.shape, draws)
        pitch = rays.pitch + _uniform("beam pitch", pitch_width, rays.pitch.shape, draws)
        return Rays(yaw, pitch, placed_as_fired=self.returns_along == "fired")


def _uniform(stream: str, width_deg: float, shape: tuple[int, ...], draws: Draws) -> Floats:
    """Angles within half of `width_deg` to either side of zero, rad."""
    return np.asarray((draws.running(stream).random(shape) - 0.5) * np.radians(width_deg))

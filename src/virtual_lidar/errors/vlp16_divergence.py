from __future__ import annotations

from typing import Literal

import numpy as np

from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensor import Sensor
from virtual_lidar.errors.model import ERROR_MODELS, Draws
from virtual_lidar.errors.vlp16 import BeamOfWidth
from virtual_lidar.sweep import Rays

CODE = ("virtual_lidar.errors.vlp16",)


@ERROR_MODELS.register("vlp16_divergence")
class Vlp16Divergence(BeamOfWidth):
    """Error model `Vlp16` with rays in random directions within the beam (thesis, section 5.5.3).

    The thesis chose this model. Each ray is turned by uniformly distributed angles, at most half of
    the beam's widths to each side. The sensor reports the nominal angles.
    """

    returns_along: Literal["fired", "nominal"] = "fired"
    """``fired``: a measured point lies on the fired ray, as in BlenSor and the thesis; only range
    noise moves it off the surface, so that divergence does not change plane residuals. ``nominal``:
    a measured point lies on the nominal ray, the only ray that a real sensor knows."""

    def perturb_rays(self, rays: Rays, sensor: Sensor, draws: Draws) -> Rays:
        yaw_width, pitch_width = self.beam_widths_deg(sensor)
        yaw = rays.yaw + _uniform("beam yaw", yaw_width, rays.yaw.shape, draws)
        pitch = rays.pitch + _uniform("beam pitch", pitch_width, rays.pitch.shape, draws)
        return Rays(yaw, pitch, placed_as_fired=self.returns_along == "fired")


def _uniform(stream: str, width_deg: float, shape: tuple[int, ...], draws: Draws) -> Floats:
    return np.asarray((draws.running(stream).random(shape) - 0.5) * np.radians(width_deg))

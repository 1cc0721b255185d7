from __future__ import annotations

from pydantic import NonNegativeFloat

from pointkit.lidar.sensor import Sensor
from virtual_lidar.errors.vlp16 import Vlp16


class BeamOfWidth(Vlp16):
    """Base class of variants of `Vlp16` whose beams have an angular width."""

    yaw_width_deg: NonNegativeFloat | None = None
    """Full horizontal width; by default the sensor's divergence."""
    pitch_width_deg: NonNegativeFloat | None = None
    """Full vertical width; by default the sensor's divergence."""

    def beam_widths_deg(self, sensor: Sensor) -> tuple[float, float]:
        yaw, pitch = self.yaw_width_deg, self.pitch_width_deg
        return (
            sensor.divergence_horizontal_deg if yaw is None else yaw,
            sensor.divergence_vertical_deg if pitch is None else pitch,
        )

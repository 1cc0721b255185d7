"""The width of a laser's beam, as an error model's parameters or else the sensor give it."""

from __future__ import annotations

from pydantic import NonNegativeFloat

from puckbench.lidar.errors.vlp16 import Vlp16
from puckbench.lidar.sensor import Sensor


class BeamOfWidth(Vlp16):
    """A model as `Vlp16` that knows the width of the laser's beam.

    Parameters
    ----------
    yaw_width_deg, pitch_width_deg
        Full widths of the beam, degrees; None for the sensor's divergence.
    """

    yaw_width_deg: NonNegativeFloat | None = None
    pitch_width_deg: NonNegativeFloat | None = None

    def beam_widths_deg(self, sensor: Sensor) -> tuple[float, float]:
        """Full widths of the beam in yaw and pitch, degrees."""
        yaw, pitch = self.yaw_width_deg, self.pitch_width_deg
        return (
            sensor.divergence_horizontal_deg if yaw is None else yaw,
            sensor.divergence_vertical_deg if pitch is None else pitch,
        )

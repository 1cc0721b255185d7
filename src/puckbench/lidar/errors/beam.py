"""The width of a laser's beam, as an error model's parameters or else the sensor give it."""

from __future__ import annotations

from typing import Protocol

from puckbench.lidar.sensor import Sensor


class BeamParameters(Protocol):
    """Full widths of the beam, degrees; None stands for the sensor's divergence."""

    @property
    def yaw_width_deg(self) -> float | None: ...  # noqa: D102

    @property
    def pitch_width_deg(self) -> float | None: ...  # noqa: D102


def beam_widths_deg(parameters: BeamParameters, sensor: Sensor) -> tuple[float, float]:
    """Full widths of the beam in yaw and pitch, degrees."""
    yaw, pitch = parameters.yaw_width_deg, parameters.pitch_width_deg
    return (
        sensor.divergence_horizontal_deg if yaw is None else yaw,
        sensor.divergence_vertical_deg if pitch is None else pitch,
    )

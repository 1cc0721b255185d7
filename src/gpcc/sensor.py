from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gpcc.syntax import MAX_LASERS, Laser
from pointkit.errors import InputError

if TYPE_CHECKING:
    from pointkit.lidar.returns import Beams

_THETA_ONE = 1 << 18
_Z_ONE = 1 << 3
_MOST = 1 << 30
_RAISED_MM = 50
"""Step, in mm, to which the height at which upper beams cross the sensor's axis is rounded."""


@dataclass(frozen=True)
class SensorDescription:
    """Description of a rotating sensor, which the encoders use to predict points.

    Lengths are in steps of the points' integer coordinates.

    Parameters
    ----------
    tan_elevation
        Tangent of each laser's elevation above the horizontal plane.
    height
        Height above `position` at which each laser's beam crosses the axis of rotation.
    steps_per_turn
        Number of shots of each laser in a turn, i.e. in one revolution of the sensor.
    position
        Integer coordinates of the sensor. The axis of rotation is parallel to z.

    Raises
    ------
    InputError
        A stream cannot hold the values.
    """

    tan_elevation: tuple[float, ...]
    height: tuple[float, ...]
    steps_per_turn: int
    position: tuple[int, int, int] = (0, 0, 0)

    def __post_init__(self) -> None:
        if not 0 < len(self.tan_elevation) == len(self.height) <= MAX_LASERS:
            raise InputError(f"G-PCC: a sensor has 1 to {MAX_LASERS} lasers, each with its height")
        if not 0 < self.steps_per_turn < _MOST or max(map(abs, self.position)) >= _MOST:
            raise InputError("G-PCC: the sensor's steps or position do not fit into a stream")
        scaled = [
            *(abs(tan) * _THETA_ONE for tan in self.tan_elevation),
            *(abs(height) * _Z_ONE for height in self.height),
        ]
        if not all(value < _MOST for value in scaled):
            raise InputError("G-PCC: the sensor's lasers do not fit into a stream")

    def lasers(self) -> list[Laser]:
        """Return the lasers as in a parameter set: lowest elevation first, with negated heights."""
        pairs = sorted(zip(self.tan_elevation, self.height, strict=True))
        return [
            Laser(_rounded(tan * _THETA_ONE), _rounded(-height * _Z_ONE), self.steps_per_turn)
            for tan, height in pairs
        ]

    def syntax_elements(self, origin: tuple[int, ...]) -> dict[str, Any]:
        """Return the syntax elements that describe the sensor in the geometry parameter set.

        Parameters
        ----------
        origin
            Origin (3,) of the sequence, from which a stream measures the sensor's position.

        Returns
        -------
        dict
            Values by the name of the syntax element.
        """
        x, y, z = (
            coordinate - zero for coordinate, zero in zip(self.position, origin, strict=True)
        )
        return {
            "geom_angular_mode_enabled_flag": 1,
            "gps_angular_origin_bits_minus1": max(max(map(abs, (x, y, z))).bit_length() - 1, 0),
            "gps_angular_origin_xyz": (x, y, z),
            "lasers": self.lasers(),
        }


def describe_sensor(
    beams: Beams, unit_m: float, steps_per_turn: int, position: tuple[int, int, int] = (0, 0, 0)
) -> SensorDescription:
    """Describe a sensor for a cloud whose integer coordinates are steps of `unit_m` metres.

    Parameters
    ----------
    beams
        Elevation, height and offset of each laser, in degrees and millimetres.
    unit_m
        Step of the coordinates, in metres.
    steps_per_turn
        Number of shots of each laser in a turn, i.e. in one revolution of the sensor.
    position
        Integer coordinates of the sensor.

    Returns
    -------
    SensorDescription
        The sensor. Its position is raised to the median height at which the upper beams cross the
        axis, because decoders find the laser of a node from the direction of the node.
    """
    height = np.asarray(beams.heights_mm)
    if beams.radial_mm:
        along = np.cos(np.radians(beams.azimuths_deg or 0.0)) * np.asarray(beams.radial_mm)
        height = height - along * np.tan(np.radians(beams.elevations_deg))
    upper = np.argsort(beams.elevations_deg)[len(height) // 2 :]
    raised = round(float(np.median(height[upper])) / _RAISED_MM) * _RAISED_MM / 1000 / unit_m
    x, y, z = position
    return SensorDescription(
        tuple(np.tan(np.radians(beams.elevations_deg)).tolist()),
        tuple((height / 1000 / unit_m - round(raised)).tolist()),
        steps_per_turn,
        (x, y, z + round(raised)),
    )


def _rounded(value: float) -> int:
    return int(math.copysign(math.floor(abs(value) + 0.5), value))

"""Trajectories of a vehicle that starts from rest, drives and turns, by a few numbers."""

from __future__ import annotations

import math

from pydantic import ConfigDict, NonNegativeFloat, PositiveFloat

from pointkit.models import Model

_STEP_S, _SUBSTEPS = 0.05, 20
_FORWARD_DEG = 90.0
"""Direction of the sensor's forward axis, y, at yaw 0, counter-clockwise from x."""


class Motion(Model):
    """Motion of a level sensor that looks where it drives.

    It stands still, accelerates to its speed, and may stop again and again. Its heading, after a
    path of s metres, is ``heading_deg + bend_deg_per_m * s + swing_deg * cos(2 pi s / swing_m)``.
    """

    model_config = ConfigDict(use_attribute_docstrings=True)

    duration_s: PositiveFloat
    speed_m_s: PositiveFloat
    """Highest speed."""
    acceleration_m_s2: PositiveFloat = 3.0
    """Acceleration, and deceleration before stops."""
    rest_s: NonNegativeFloat = 0.5
    """Time before the sensor starts."""
    stop_every_s: PositiveFloat | None = None
    """Period of stop and go: in its second half, the sensor slows down and stands; by default it
    never stops."""
    start: tuple[float, float] = (0.0, 0.0)
    """First position, x and y in m, relative to the scan's origin."""
    heading_deg: float = 0.0
    """Mean direction of travel in degrees, counter-clockwise from the x axis."""
    swing_deg: float = 0.0
    """By how many degrees the heading swings to each side of its mean."""
    swing_m: PositiveFloat = 25.0
    """Length of the path, in m, in which the heading swings to both sides once."""
    bend_deg_per_m: float = 0.0
    """Turn of the mean heading per metre: 57.3 / radius, positive to the left."""

    def rows(self) -> tuple[tuple[float, ...], ...]:
        """Return rows of t, x, y, z, yaw, pitch, roll (s, m, degrees), one every 0.05 s."""
        (x, y), path, speed, rows = self.start, 0.0, 0.0, []
        step = _STEP_S / _SUBSTEPS
        for number in range(math.ceil(self.duration_s / _STEP_S - 1e-9) + 1):
            time = number * _STEP_S
            pose = (time, x, y, 0.0, self._heading(path) - _FORWARD_DEG, 0.0, 0.0)
            rows.append(tuple(round(value, 6) + 0.0 for value in pose))
            for part in range(_SUBSTEPS):
                change = self._wanted_speed(time + part * step) - speed
                most = self.acceleration_m_s2 * step
                speed += min(max(change, -most), most)
                heading = math.radians(self._heading(path + speed * step / 2))
                x, y = x + speed * step * math.cos(heading), y + speed * step * math.sin(heading)
                path += speed * step
        return tuple(rows)

    def _heading(self, path: float) -> float:
        swing = self.swing_deg * math.cos(2 * math.pi * path / self.swing_m)
        return self.heading_deg + self.bend_deg_per_m * path + swing

    def _wanted_speed(self, time: float) -> float:
        driven = time - self.rest_s
        if driven < 0:
            return 0.0
        period = self.stop_every_s
        return self.speed_m_s if period is None or driven % period < period / 2 else 0.0

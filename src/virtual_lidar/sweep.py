"""The rotation and motion of a virtual sensor during a scan.

The axes are x right, y forward and z up. As in the simulator BlenSor, the sensor rotates about z,
starting from the forward direction, counter-clockwise seen from above. Pitch rotates the whole
sensor about x, upwards positive. By default, all lasers fire at the same moment in each azimuth
step, and the sensor has one pose in each frame. With ``timing="firing"``, each laser has its own
firing time; with a trajectory, each azimuth step has its own pose.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import ConfigDict, NonNegativeInt, PositiveFloat, model_validator

from pointkit.errors import InputError, among
from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensor import Sensor
from pointkit.models import Model, parsed
from virtual_lidar.trajectory import Motion, Poses, Trajectory, read_rows, trajectory_from_rows

# Blender up to 2.79, on which BlenSor is built, places the handles of an automatic Bezier key at
# the length of the interval over this number (blenkernel/intern/curve.c, calchandleNurb_intern),
# level at the first and the last key (fcurve.c, calchandles_fcurve).
_HANDLE_DIVISOR = 2.5614


@dataclass(frozen=True)
class Rays:
    """Directions in which lasers fire, in sensor coordinates.

    All arrays have the shape (frames, azimuth steps, lasers).

    Parameters
    ----------
    yaw
        Azimuths from the forward direction (y), counter-clockwise seen from above, rad.
    pitch
        Elevations, upwards positive, rad.
    placed_as_fired
        Whether a measured point is placed on the ray with this direction. If false, it is placed on
        the nominal ray, i.e. the ray without errors.
    """

    yaw: Floats
    pitch: Floats
    placed_as_fired: bool = True


class Sweep(Model):
    """How a virtual sensor rotates and moves during a scan.

    `open_sweep` creates a sweep from a named preset and a few values. The defaults are those of the
    thesis, section 5.2.
    """

    model_config = ConfigDict(use_attribute_docstrings=True)

    frames_per_second: PositiveFloat = 120.0
    """Frames per second, which need not be turns; without a trajectory, a frame has one pose."""
    duration_s: PositiveFloat = 4.0
    """Duration of the scan."""
    pitch_start_deg: float = -60.0
    """Pitch of the sensor in the first frame, upwards positive."""
    pitch_end_deg: float = 60.0
    """Pitch in the last frame; in between, the pitch follows Blender's easing."""
    rotation_hz: PositiveFloat | None = None
    """Rotations per second; by default the sensor's."""
    azimuth_step_deg: PositiveFloat | None = None
    """Azimuth step between firings; by default the sensor's."""
    max_range_m: PositiveFloat | None = None
    """Longest range; by default the sensor's."""
    frames_skipped: NonNegativeInt = 0
    """Number of frames at the end that are not scanned; the last of them has `pitch_end_deg`."""
    timing: Literal["step", "firing"] = "step"
    """``step``: the lasers of an azimuth step fire together, as in BlenSor. ``firing``: each laser
    has its firing time, and the azimuth at that time; a step is the rotation during a firing
    sequence."""
    trajectory: tuple[tuple[float, ...], ...] | None = None
    """Poses that replace the pitch, as rows for `trajectory.trajectory_from_rows`: times are
    relative to the start of the sweep, positions to the scan's origin. Each azimuth step has a pose
    (rolling shutter); a single row is a fixed pose."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.frames < 1:
            raise InputError(
                f"the sweep has no frame ({self.duration_s} s, {self.frames_per_second}/s)"
            )
        if self.timing == "firing" and self.azimuth_step_deg is not None:
            raise InputError("azimuth_step_deg is given, but timing 'firing' sets the step")
        self._check_trajectory()
        return self

    def _check_trajectory(self) -> None:
        if self._trajectory is None or len(self._trajectory.times) == 1:
            return
        start, end = self._trajectory.times[[0, -1]]
        if start > 0 or end < self.duration_s * (1 - 1e-9):
            raise InputError(
                f"trajectory is from {start:g} to {end:g} s,"
                f" the sweep from 0 to {self.duration_s:g} s"
            )

    @cached_property
    def _trajectory(self) -> Trajectory | None:
        return None if self.trajectory is None else trajectory_from_rows(self.trajectory)

    @property
    def frames(self) -> int:
        """Number of frames that are scanned."""
        return self._keyed_frames - self.frames_skipped

    @property
    def _keyed_frames(self) -> int:
        return round(self.duration_s * self.frames_per_second)

    def pitch_rad(self) -> Floats:
        """Return the sensor's pitch in each frame, (frames,), rad; a trajectory replaces it."""
        time = np.arange(self.frames) / max(self._keyed_frames - 1, 1)
        span = self.pitch_end_deg - self.pitch_start_deg
        return np.radians(self.pitch_start_deg + span * ease(time))

    def rotations(self) -> Floats:
        """Return a rotation matrix from the sensor to the world for each frame, (frames, 3, 3).

        The matrices follow from the pitch and do not apply to a sweep with a trajectory.
        """
        pitch = self.pitch_rad()
        sine, cosine = np.sin(pitch), np.cos(pitch)
        rotations = np.tile(np.eye(3), (len(pitch), 1, 1))
        rotations[:, 1, 1] = rotations[:, 2, 2] = cosine
        rotations[:, 1, 2], rotations[:, 2, 1] = -sine, sine
        return rotations

    def poses(self, sensor: Sensor, frames: range) -> Poses:
        """Return the sensor's pose in each azimuth step of the given frames.

        Parameters
        ----------
        sensor
            The sensor, which determines the number of azimuth steps.
        frames
            Numbers of the frames.

        Returns
        -------
        Poses
            Rotations (frames, azimuth steps, 3, 3), and positions (frames, azimuth steps, 3), m,
            relative to the scan's origin.
        """
        shape = (len(frames), self.steps(sensor))
        if self._trajectory is not None:
            return self._trajectory.at(self.timestamps(sensor, frames))
        rotations = self.rotations()[frames.start : frames.stop, None]
        rotations = np.broadcast_to(rotations, (*shape, 3, 3))
        return Poses(rotations, np.broadcast_to(0.0, (*shape, 3)))

    def poses_during(self, times: Floats) -> Poses:
        """Return the poses of the trajectory at the given times.

        Parameters
        ----------
        times
            Times, (n,), in s after the start of the sweep.

        Returns
        -------
        Poses
            Rotations (n, 3, 3), and positions (n, 3), m, relative to the scan's origin.

        Raises
        ------
        InputError
            The sweep has no trajectory.
        """
        if self._trajectory is None:
            raise InputError("the sweep has no trajectory, along which the sensor moves")
        return self._trajectory.at(times)

    @property
    def is_level_and_still(self) -> bool:
        """Whether the sensor neither moves nor pitches."""
        return self._trajectory is None and self.pitch_start_deg == 0 and self.pitch_end_deg == 0

    def way(self) -> tuple[Floats, Floats]:
        """Return the sensor's path as a polyline: times (n,), s, and positions (n, 3), m.

        Positions are relative to the scan's origin. A sensor at rest has one time and one position.
        """
        if self._trajectory is None:
            return np.zeros(1), np.zeros((1, 3))
        keyed = self._trajectory.times
        if len(keyed) == 1:
            return np.zeros(1), self._trajectory.positions
        within = keyed[(keyed > 0) & (keyed < self.duration_s)]
        times = np.concatenate([[0.0], within, [self.duration_s]])
        return times, self._trajectory.at(times).positions

    def steps(self, sensor: Sensor) -> int:
        """Return the number of whole azimuth steps in a frame; raise InputError if it is 0."""
        steps = self._degrees_per_frame(sensor) / self.step_deg(sensor)
        count = int(steps * (1 + 1e-9))
        if count < 1:
            raise InputError(
                f"a frame of the sweep has {steps:.3g} azimuth steps, needs at least one"
            )
        return count

    def rays(self, sensor: Sensor, frames: range) -> Rays:
        """Return the nominal rays, i.e. those without errors, of the given frames.

        The azimuth at the start of a frame is the one at which the previous frame ended.

        Parameters
        ----------
        sensor
            The sensor, which determines the elevations of the lasers.
        frames
            Numbers of the frames.

        Returns
        -------
        Rays
            Angles in arrays of shape (frames, azimuth steps, lasers).
        """
        starts = np.asarray(frames) * self._degrees_per_frame(sensor)
        steps = np.arange(self.steps(sensor)) * self.step_deg(sensor)
        degrees = (starts[:, None] + steps)[:, :, None]
        if self.timing == "firing":
            degrees = degrees + 360.0 * self.turning_hz(sensor) * _delays(sensor)
        yaw = np.radians(np.mod(degrees, 360.0))
        pitch = np.radians(sensor.laser_elevation_deg)
        shape = (*yaw.shape[:2], sensor.lasers)
        return Rays(np.broadcast_to(yaw, shape), np.broadcast_to(pitch, shape))

    def timestamps(self, sensor: Sensor, frames: range) -> Floats:
        """Return when azimuth steps begin, (frames, azimuth steps), s after the sweep's start."""
        second_per_step = self.step_deg(sensor) / (360.0 * self.turning_hz(sensor))
        within = np.arange(self.steps(sensor)) * second_per_step
        return np.asarray(np.asarray(frames)[:, None] / self.frames_per_second + within)

    def firing_times(self, sensor: Sensor, frames: range) -> Floats:
        """Return when lasers fire, (frames, azimuth steps, lasers), s after the sweep's start."""
        steps = self.timestamps(sensor, frames)[:, :, None]
        fired = steps + _delays(sensor) if self.timing == "firing" else steps
        return np.broadcast_to(fired, (*steps.shape[:2], sensor.lasers))

    def turning_hz(self, sensor: Sensor) -> float:
        """Return the number of the sensor's revolutions per second."""
        return sensor.rotation_hz if self.rotation_hz is None else self.rotation_hz

    def step_deg(self, sensor: Sensor) -> float:
        """Return the angle between successive azimuth steps, degrees.

        With the timing ``firing``, the angle is the rotation during one firing sequence of the
        sensor. Raises InputError if the sensor does not state the length of that sequence.
        """
        if self.timing == "firing":
            return 360.0 * self.turning_hz(sensor) * _sequence_s(sensor)
        return sensor.azimuth_step_deg if self.azimuth_step_deg is None else self.azimuth_step_deg

    def _degrees_per_frame(self, sensor: Sensor) -> float:
        return 360.0 * self.turning_hz(sensor) / self.frames_per_second


def _delays(sensor: Sensor) -> Floats:
    return np.array(sensor.firing_times_us) * 1e-6


def _sequence_s(sensor: Sensor) -> float:
    if sensor.firing_sequence_us is None:
        raise InputError(f"sensor {sensor.name} does not state its firing_sequence_us")
    return sensor.firing_sequence_us * 1e-6


SWEEPS: dict[str, dict[str, Any]] = {
    "thesis": {},
    "thesis_room": {
        "frames_per_second": 24.0,
        "frames_skipped": 1,
        "rotation_hz": 10.0,
        "azimuth_step_deg": 0.1728,
        "max_range_m": 120.0,
    },
    "spin": {
        "frames_per_second": 5.0,
        "rotation_hz": 5.0,
        "duration_s": 0.2,
        "pitch_start_deg": 0.0,
        "pitch_end_deg": 0.0,
    },
}
"""Fields of `Sweep` by name of a preset.

``thesis_room`` has the room scans of the thesis, with BlenSor's defaults instead of the VLP-16's.
"""


def open_sweep(settings: str | Mapping[str, Any] = "thesis") -> Sweep:
    """Create a sweep from a named preset, from values of your own, or from both.

    Parameters
    ----------
    settings
        The name of a preset in `SWEEPS`, or a dictionary. The preset ``"spin"`` is one revolution
        of a level sensor at rest, in one frame; ``"thesis"`` and ``"thesis_room"`` are the scans of
        the thesis. A dictionary has fields of `Sweep` by name, such as ``{"preset": "spin",
        "timing": "firing"}``; fields that it omits have the values of its preset, by default
        ``"thesis"``. The field ``trajectory`` may also be the path of a file (`read_rows`) or a
        dictionary with the fields of a `Motion`. A trajectory determines the duration of the sweep
        unless ``duration_s`` is given.

    Returns
    -------
    Sweep
        The checked sweep.

    Raises
    ------
    InputError
        There is no such preset or field, or a value is invalid.
    """
    options: dict[str, Any] = {"preset": settings} if isinstance(settings, str) else dict(settings)
    name = options.pop("preset", "thesis")
    if name not in SWEEPS:
        raise InputError(f"unknown sweep {name!r}{among(name, SWEEPS)}")
    if isinstance(options.get("trajectory"), str):
        options["trajectory"] = read_rows(Path(options["trajectory"]))
    if isinstance(options.get("trajectory"), Mapping):
        options["trajectory"] = parsed(Motion, options["trajectory"], "trajectory").rows()
    if "duration_s" not in options:
        options |= _duration(options.get("trajectory"))
    return parsed(Sweep, {**SWEEPS[name], **options}, f"sweep {name}")


def _duration(rows: Any) -> dict[str, float]:
    if isinstance(rows, (list, tuple)) and len(rows) > 1 and isinstance(rows[-1], (list, tuple)):
        return {"duration_s": rows[-1][0]} if rows[-1] else {}
    return {}


def ease(time: Floats) -> Floats:
    """Return a value that rises smoothly from 0 to 1 with time, as Blender animates by default.

    The curve of the value over time is the Bezier curve with the control points (0, 0), (h, 0), (1
    - h, 1) and (1, 1), where h = 1 / 2.5614.

    Parameters
    ----------
    time
        Times from 0 to 1, in an array of any shape.

    Returns
    -------
    array
        Values from 0 to 1, in the shape of `time`.
    """
    h = 1 / _HANDLE_DIVISOR
    s = np.array(time, dtype=np.float64)
    for _ in range(6):
        value = 3 * h * s * (1 - s) ** 2 + 3 * (1 - h) * s**2 * (1 - s) + s**3
        slope = 3 * h * (1 - s) ** 2 + 6 * (1 - 2 * h) * s * (1 - s) + 3 * h * s**2
        s -= (value - time) / slope
    return np.asarray(s**2 * (3 - 2 * s))

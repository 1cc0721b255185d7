"""The sweep of a scan: frames of rays while the sensor turns and its pitch eases from end to end.

Conventions, those of BlenSor with its camera's axes named for a level sensor: x right, y forward,
z up; the sensor turns about z, counter-clockwise seen from above, starting forward; pitch turns
it about x, upwards positive. All lasers of an azimuth step fire together; one pose per frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from puckbench.cloud import Floats
from puckbench.errors import InputError
from puckbench.sensor.options import check_above_zero, check_at_least, from_options
from puckbench.sensor.sensor import Sensor

# Blender puts the handles of an automatic Bezier key at the length of the interval over this
# number (blenkernel/intern/curve.c, calchandleNurb_intern; in use up to 2.79, on which BlenSor is
# built), and levels them at the first and the last key (fcurve.c, calchandles_fcurve).
_HANDLE_DIVISOR = 2.5614


@dataclass(frozen=True)
class Rays:
    """Angles in the sensor's frame that rays are fired at, rad, shape (frames, steps, lasers).

    The arrays may be broadcast views. `placed_as_fired` says where a return of these rays is put:
    along the fired ray, or (false) along the nominal one, as a real sensor must, which knows no
    other.
    """

    yaw: Floats
    pitch: Floats
    placed_as_fired: bool = True


@dataclass(frozen=True)
class Sweep:
    """A sweep as the thesis ran it (section 5.2): 4 s at 120 frames per second, pitch -60..60 deg.

    None means the sensor's own value. `frames_skipped` frames at the end are keyed but not
    scanned (the room scans of the thesis leave out the last one).
    """

    frames_per_second: float = 120.0
    duration_s: float = 4.0
    pitch_start_deg: float = -60.0
    pitch_end_deg: float = 60.0
    rotation_hz: float | None = None
    azimuth_step_deg: float | None = None
    max_range_m: float | None = None
    frames_skipped: int = 0

    def __post_init__(self) -> None:
        check_above_zero(self, "frames_per_second", "duration_s", "rotation_hz")
        check_above_zero(self, "azimuth_step_deg", "max_range_m")
        check_at_least(self, 0, "frames_skipped")
        if self.frames < 1:
            raise InputError(
                f"the sweep has no frame ({self.duration_s} s, {self.frames_per_second}/s)"
            )

    @property
    def frames(self) -> int:
        """Number of frames that are scanned."""
        return self._keyed_frames - self.frames_skipped

    @property
    def _keyed_frames(self) -> int:
        return round(self.duration_s * self.frames_per_second)

    def pitch_rad(self) -> Floats:
        """Pitch of the sensor in each frame, (frames,): keyed in the first and the last frame."""
        time = np.arange(self.frames) / max(self._keyed_frames - 1, 1)
        span = self.pitch_end_deg - self.pitch_start_deg
        return np.radians(self.pitch_start_deg + span * ease(time))

    def rotations(self) -> Floats:
        """Rotation of each frame from the sensor's frame to the world, (frames, 3, 3)."""
        sine, cosine = np.sin(self.pitch_rad()), np.cos(self.pitch_rad())
        rotations = np.zeros((self.frames, 3, 3))
        rotations[:, 0, 0] = 1
        rotations[:, 1, 1] = rotations[:, 2, 2] = cosine
        rotations[:, 1, 2], rotations[:, 2, 1] = -sine, sine
        return rotations

    def steps(self, sensor: Sensor) -> int:
        """Azimuth steps in a frame: the whole ones that its share of a turn has room for."""
        steps = self._degrees_per_frame(sensor) / self._step_deg(sensor)
        count = int(steps * (1 + 1e-9))
        if count < 1:
            raise InputError(
                f"a frame of the sweep has {steps:.3g} azimuth steps, needs at least one"
            )
        return count

    def rays(self, sensor: Sensor, frames: range) -> Rays:
        """Nominal rays of the given frames; azimuth runs on from frame to frame."""
        starts = np.asarray(frames) * self._degrees_per_frame(sensor)
        steps = np.arange(self.steps(sensor)) * self._step_deg(sensor)
        yaw = np.radians(np.mod(starts[:, None] + steps, 360.0))[:, :, None]
        pitch = np.radians(sensor.laser_elevation_deg)
        shape = (*yaw.shape[:2], sensor.lasers)
        return Rays(np.broadcast_to(yaw, shape), np.broadcast_to(pitch, shape))

    def timestamps(self, sensor: Sensor, frames: range) -> Floats:
        """Seconds since the sweep's start at which each step of the given frames fires.

        Shape (frames, steps); all lasers of a step fire together, as in BlenSor.
        """
        second_per_step = self._step_deg(sensor) / (360.0 * self._rotation_hz(sensor))
        within = np.arange(self.steps(sensor)) * second_per_step
        return np.asarray(np.asarray(frames)[:, None] / self.frames_per_second + within)

    def _rotation_hz(self, sensor: Sensor) -> float:
        return sensor.rotation_hz if self.rotation_hz is None else self.rotation_hz

    def _step_deg(self, sensor: Sensor) -> float:
        return sensor.azimuth_step_deg if self.azimuth_step_deg is None else self.azimuth_step_deg

    def _degrees_per_frame(self, sensor: Sensor) -> float:
        return 360.0 * self._rotation_hz(sensor) / self.frames_per_second


# `thesis_room`: the room scans as run, with BlenSor's own defaults instead of the VLP-16's.
SWEEPS: dict[str, dict[str, Any]] = {
    "thesis": {},
    "thesis_room": {
        "frames_per_second": 24.0,
        "frames_skipped": 1,
        "rotation_hz": 10.0,
        "azimuth_step_deg": 0.1728,
        "max_range_m": 120.0,
    },
}


def open_sweep(settings: str | Mapping[str, Any] = "thesis") -> Sweep:
    """A sweep by the name of a preset, or by values that differ from a preset.

    The entry ``preset`` of a mapping names it (default: ``thesis``), for example
    ``{"preset": "thesis_room", "duration_s": 1.0}``. Raises InputError for an unknown name.
    """
    options = {"preset": settings} if isinstance(settings, str) else dict(settings)
    name = options.pop("preset", "thesis")
    if name not in SWEEPS:
        raise InputError(f"unknown sweep {name!r} (known: {', '.join(SWEEPS)})")
    return from_options(Sweep, {**SWEEPS[name], **options}, f"sweep {name}")


def ease(time: Floats) -> Floats:
    """Blender's default Bezier interpolation from 0 to 1 (slow in, slow out) at `time` in [0, 1].

    The curve has the control points (0, 0), (h, 0), (1 - h, 1), (1, 1) with h = 1 / 2.5614; its
    parameter at a time is found by Newton's method: the slope of time over the parameter stays
    within 0.91 and 1.18.
    """
    h = 1 / _HANDLE_DIVISOR
    s = np.array(time, dtype=np.float64)
    for _ in range(6):
        value = 3 * h * s * (1 - s) ** 2 + 3 * (1 - h) * s**2 * (1 - s) + s**3
        slope = 3 * h * (1 - s) ** 2 + 6 * (1 - 2 * h) * s * (1 - s) + 3 * h * s**2
        s -= (value - time) / slope
    return np.asarray(s**2 * (3 - 2 * s))

"""Turns of a VLP-16 in a round room as clouds (PointCloud2), with times and lasers of any kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensors import load_sensor
from tests.support.cloud_bags import Rows, cloud_bag

ELEVATIONS = np.sort(np.asarray(load_sensor("vlp16").laser_elevation_deg))
COLUMNS, TURN_S, STAMP_S, BOOT_S = 64, 0.125, 1.7e9, 5000.0
"""Times are multiples of 1/512 s, which numbers in s, us and ns represent exactly."""
SINCE_S: Floats = np.repeat(np.arange(COLUMNS), 16) / COLUMNS * TURN_S
"""Time of each point of a turn since its beginning, s."""
RANKS = np.tile(np.arange(16), COLUMNS)
Time = Callable[[Floats, float], Any]
"""The values of a time field, from seconds since a turn's beginning and since the recording's."""


def turn(
    number: int = 0,
    name: str = "time",
    kind: str = "<f4",
    time: Time | None = lambda since, _: since,
    ring: Any = RANKS,
    ring_kind: str = "<u2",
    intensity: Any = 7,
    laser: str = "ring",
    step_s: float = TURN_S,
) -> Rows:
    """Turn `number`, in ROS's axes, at a distance of 5 m."""
    fields = [*((axis, "<f4") for axis in "xyz"), ("intensity", "<f8")]
    fields += [(laser, ring_kind)] if ring is not None else []
    fields += [(name, kind)] if time is not None else []
    rows = np.zeros(len(SINCE_S), fields)
    clockwise, elevation = 2 * np.pi * SINCE_S / TURN_S, np.radians(ELEVATIONS)[RANKS]
    rows["x"] = 5 * np.cos(elevation) * np.cos(clockwise)
    rows["y"] = -5 * np.cos(elevation) * np.sin(clockwise)
    rows["z"] = 5 * np.sin(elevation)
    rows["intensity"] = intensity
    if ring is not None:
        rows[laser] = ring
    if time is not None:
        rows[name] = time(SINCE_S, step_s * number)
    return rows


def turns(count: int = 4, **options: Any) -> list[Rows]:
    return [turn(number, **options) for number in range(count)]


def bag(
    path: Path,
    clouds: Sequence[Rows],
    stamps_s: Sequence[float] | None = None,
    frames: Sequence[str] = (),
) -> Path:
    """Write the clouds to a bag; by default, stamps are those of turns at 8 Hz."""
    if stamps_s is None:
        stamps_s = [STAMP_S + TURN_S * number for number in range(len(clouds))]
    return cloud_bag(path, {"/points": clouds}, stamps_s, frames=frames)


def points(clouds: Sequence[Rows]) -> Floats:
    """The clouds' points in the sensor's axes."""
    rows = np.concatenate(clouds)
    return np.column_stack([-rows["y"], rows["x"], rows["z"]]).astype(np.float64)


def seconds(count: int = 4) -> Floats:
    """True times of the points of turns, s."""
    return np.concatenate([TURN_S * number + SINCE_S for number in range(count)])

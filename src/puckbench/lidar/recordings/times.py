from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats

TimeUnit = Literal["s", "ms", "us", "ns"]
TIME_UNITS: tuple[TimeUnit, ...] = get_args(TimeUnit)
PER_SECOND: dict[TimeUnit, int] = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
_ROTATION_HZ = 10.0
"""Sensors rotate at this rate within a factor of 2, which suffices to infer the unit of times."""
_LARGEST_FACTOR = 1000**0.5
_LARGEST_STEP_RAD = np.radians(30)
"""Limit of the rotation between two firings; packets of a Puck at 20 Hz are 10 degrees apart."""
_FEWEST_STEPS = 8
_YEAR_2000_S, _YEAR_2100_S = 946_684_800, 4_102_444_800
_DAY_S = 86400.0


def unit_of(times: NDArray[Any], azimuth: Floats) -> TimeUnit | None:
    """Infer the unit (s, ms, us or ns) of times (n,); None if it is unknown.

    With the right unit, the azimuths (n,), rad, rotate about ten times a second, or else times
    since 1970 lie in this century. If no unit fits, the unit of integers is unknown, and that of
    other numbers is s.
    """
    unit = _unit_by_rotation(times, azimuth) or _unit_since_1970(times)
    is_whole = times.dtype.kind in "iu" and np.ptp(times) > 0
    return unit or (None if is_whole else "s")


def seconds_of(times: NDArray[Any], unit: TimeUnit) -> Floats:
    """Convert times to s; integers and times since 1970 become relative to the earliest time."""
    if times.dtype.kind in "iu" or is_since_1970(times, unit):
        times = times - times.min()
    seconds: Floats = np.asarray(times, dtype=np.float64) / PER_SECOND[unit]
    return seconds


def is_since_1970(times: NDArray[Any], unit: TimeUnit) -> bool:
    """Whether times in this unit since 1970 lie in this century."""
    return _unit_since_1970(times) == unit


def _unit_by_rotation(times: NDArray[Any], azimuth: Floats) -> TimeUnit | None:
    instants, rows = np.unique(times, return_index=True)
    steps = np.diff(instants).astype(np.float64)
    turned = np.abs(np.mod(np.diff(azimuth[rows]) + np.pi, 2 * np.pi) - np.pi)
    near = turned < _LARGEST_STEP_RAD
    if near.sum() < max(_FEWEST_STEPS, len(near) / 2) or not turned[near].any():
        return None
    turns = turned[near].sum() / (2 * np.pi) / steps[near].sum()
    off = {unit: abs(np.log(turns * ticks / _ROTATION_HZ)) for unit, ticks in PER_SECOND.items()}
    best = min(off, key=lambda unit: off[unit])
    return best if off[best] < np.log(_LARGEST_FACTOR) else None


def _unit_since_1970(times: NDArray[Any]) -> TimeUnit | None:
    first, last = float(times.min()), float(times.max())
    for unit, ticks in PER_SECOND.items():
        is_of_day = last - first <= _DAY_S * ticks
        if is_of_day and _YEAR_2000_S * ticks <= first and last < _YEAR_2100_S * ticks:
            return unit
    return None

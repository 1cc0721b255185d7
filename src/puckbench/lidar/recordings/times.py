"""Units of the times in clouds of other decoders."""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats

TimeUnit = Literal["s", "ms", "us", "ns"]
TIME_UNITS: tuple[TimeUnit, ...] = get_args(TimeUnit)
_PER_SECOND: dict[TimeUnit, int] = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
_ROTATION_HZ = 10.0
"""Of sensors, within a factor of 2: units are 1000 apart."""
_MOST_OFF = 1000**0.5
_MOST_TURNED = np.radians(30)
"""Between two instants of firing, at most; packets of a Puck at 20 Hz are 10 degrees apart."""
_FEWEST_STEPS = 8
_FIRST, _LAST = 946_684_800, 4_102_444_800
"""The years 2000 and 2100, s since 1970."""
_DAY_S = 86400.0


def unit_of(times: NDArray[Any], azimuth: Floats) -> TimeUnit | None:
    """The unit of times (n,), or None where whole numbers do not tell it.

    The unit with which the sensor turns about ten times a second; where the azimuths (n,), rad, do
    not show that, the unit with which times since 1970 lie in this century; else seconds for
    numbers that are not whole by their type, or all equal.
    """
    unit = _unit_by_rotation(times, azimuth) or _unit_since_1970(times)
    is_whole = times.dtype.kind in "iu" and np.ptp(times) > 0
    return unit or (None if is_whole else "s")


def seconds_of(times: NDArray[Any], unit: TimeUnit) -> Floats:
    """Times in s, those in whole numbers or since 1970 after the first of them."""
    if times.dtype.kind in "iu" or _unit_since_1970(times) == unit:
        times = times - times.min()
    seconds: Floats = np.asarray(times, dtype=np.float64) / _PER_SECOND[unit]
    return seconds


def _unit_by_rotation(times: NDArray[Any], azimuth: Floats) -> TimeUnit | None:
    instants, rows = np.unique(times, return_index=True)
    steps = np.diff(instants).astype(np.float64)
    turned = np.abs(np.mod(np.diff(azimuth[rows]) + np.pi, 2 * np.pi) - np.pi)
    near = turned < _MOST_TURNED
    if near.sum() < max(_FEWEST_STEPS, len(near) / 2) or not turned[near].any():
        return None
    turns = turned[near].sum() / (2 * np.pi) / steps[near].sum()
    off = {unit: abs(np.log(turns * ticks / _ROTATION_HZ)) for unit, ticks in _PER_SECOND.items()}
    best = min(off, key=lambda unit: off[unit])
    return best if off[best] < np.log(_MOST_OFF) else None


def _unit_since_1970(times: NDArray[Any]) -> TimeUnit | None:
    first, last = float(times.min()), float(times.max())
    for unit, ticks in _PER_SECOND.items():
        is_of_day = last - first <= _DAY_S * ticks
        if is_of_day and _FIRST * ticks <= first and last < _LAST * ticks:
            return unit
    return None

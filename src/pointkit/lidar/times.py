"""Inference of the unit of points' times, and of leaps of the clock, from the times themselves."""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats

TimeUnit = Literal["s", "ms", "us", "ns"]
TIME_UNITS: tuple[TimeUnit, ...] = get_args(TimeUnit)
PER_SECOND: dict[TimeUnit, int] = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
_ROTATION_HZ = 10.0
"""Sensors rotate at this rate within a factor of 2, which suffices to infer the unit of times."""
_LARGEST_FACTOR = 1000**0.5
_LARGEST_STEP_RAD = np.radians(30)
"""Limit of the rotation between two firings; packets of a Puck at 20 Hz are 10 degrees apart."""
_FEWEST_STEPS = 8
_NO_LEAP = 0.95
"""Share of the steps between times that contain no leap of the clock."""
_YEAR_2000_S, _YEAR_2100_S = 946_684_800, 4_102_444_800
_DAY_S = 86400.0
_COARSEST_S = 1e-3
"""Coarsest usable step between times, in s: a hundredth of a turn at 10 turns per second."""
_OFF_ONE = 0.02
"""Tolerance of the one turn per unit if times are shares of turns."""
_MOST_FALLS = 10
_LEAP_S = 1.0


def unit_of(times: NDArray[Any], azimuth: Floats, turn_s: float | None = None) -> TimeUnit | None:
    """Infer the unit of times: s, ms, us or ns.

    The unit is right if the azimuths rotate about ten times a second, if times since 1970 lie in
    this century, or if the times of a revolution take about `turn_s`. If no unit is right, integers
    have an unknown unit, and other numbers within a day are in s.

    Parameters
    ----------
    times
        Times, (n,).
    azimuth
        Azimuths, (n,), rad.
    turn_s
        Duration of a revolution of the sensor, s, if known.

    Returns
    -------
    str or None
        The unit; None if it is unknown.
    """
    span = float(np.ptp(times))
    unit = _unit_by_rotation(times, azimuth) or _unit_since_1970(times)
    if unit is None and span and turn_s:
        unit = _nearest_unit(1 / span, 1 / turn_s)
    is_unknown = span > (0 if times.dtype.kind in "iu" else _DAY_S)
    return unit or (None if is_unknown else "s")


def fault_of(times: NDArray[Any], unit: TimeUnit, azimuth: Floats | None) -> str | None:
    """Return why times cannot be the times of laser firings; None if they can.

    Parameters
    ----------
    times
        Times, (n,).
    unit
        Unit of the times.
    azimuth
        Azimuths, (n,), rad. With them, times that are only fractions of a revolution are
        recognised.
    """
    if times.dtype.kind == "f":
        step = float(np.spacing(np.abs(times).max())) / PER_SECOND[unit]
        if step > _COARSEST_S:
            return f"has times of {times.dtype} in steps of {step:g} s"
    if len(times) > 1 and np.ptp(times) == 0:
        return f"has one time for all points ({times[0]:g})"
    if azimuth is not None and are_shares(times, azimuth):
        return f"has shares of a turn ({times.min():g} to {times.max():g}), which are no times"
    return None


def are_shares(times: NDArray[Any], azimuth: Floats) -> bool:
    """Return whether times (n,) are fractions of a revolution, as azimuths (n,), rad, tell.

    Lasers may fire at different azimuths, since only the sum of the rotations counts.
    """
    if times.dtype.kind != "f" or np.ptp(times) > 1 or np.abs(times).max() > 1:
        return False
    steps, turned = _near_steps(times, azimuth)
    turns, span = abs(turned.sum()) / (2 * np.pi), steps.sum()
    return bool(abs(turns - span) < _OFF_ONE * span)


def seconds_of(times: NDArray[Any], unit: TimeUnit) -> Floats:
    """Convert times to seconds.

    Integers, and times since 1970, become relative to the earliest time.
    """
    if times.dtype.kind in "iu" or is_since_1970(times, unit):
        times = times - times.min()
    seconds: Floats = np.asarray(times, dtype=np.float64) / PER_SECOND[unit]
    return seconds


def is_since_1970(times: NDArray[Any], unit: TimeUnit) -> bool:
    """Return whether times (n,), counted in this unit since 1970, lie in this century."""
    return _unit_since_1970(times) == unit


def falls(times: NDArray[Any]) -> bool:
    """Return whether times (n,) mostly decrease from each point to the next.

    This is the case if there are more than 10 times as many decreases as increases.
    """
    fallen, risen = (times[1:] < times[:-1]).sum(), (times[1:] > times[:-1]).sum()
    return bool(fallen > _MOST_FALLS * risen)


def largest_leap(seconds: Floats) -> tuple[float, float] | None:
    """Return the largest gap between successive times, s, and the time before the gap.

    The result is None if no gap exceeds 1 s.
    """
    if not len(seconds) or np.ptp(seconds) <= _LEAP_S:
        return None
    instants = np.unique(seconds)
    steps = np.diff(instants)
    if steps.max() <= _LEAP_S:
        return None
    return float(steps.max()), float(instants[int(np.argmax(steps))])


def _unit_by_rotation(times: NDArray[Any], azimuth: Floats) -> TimeUnit | None:
    turns = _turns_per_tick(times, azimuth)
    return None if turns is None else _nearest_unit(turns, _ROTATION_HZ)


def _nearest_unit(per_tick: float, per_second: float) -> TimeUnit | None:
    """Return the unit of ticks for which `per_tick` matches `per_second` within a factor of 31."""
    off = {unit: abs(np.log(per_tick * ticks / per_second)) for unit, ticks in PER_SECOND.items()}
    best = min(off, key=lambda unit: off[unit])
    return best if off[best] < np.log(_LARGEST_FACTOR) else None


def _turns_per_tick(times: NDArray[Any], azimuth: Floats) -> float | None:
    steps, turned = _near_steps(times, azimuth)
    if not turned.any():
        return None
    usual = steps <= np.quantile(steps, _NO_LEAP)
    return float(np.abs(turned[usual]).sum() / (2 * np.pi) / steps[usual].sum())


def _near_steps(times: NDArray[Any], azimuth: Floats) -> tuple[Floats, Floats]:
    """Return the steps between successive times, and between their azimuths if these are small.

    If most steps of azimuths are large, the result is empty.
    """
    instants, rows = np.unique(times, return_index=True)
    steps = np.diff(instants).astype(np.float64)
    turned = np.mod(np.diff(azimuth[rows]) + np.pi, 2 * np.pi) - np.pi
    near = np.abs(turned) < _LARGEST_STEP_RAD
    if near.sum() < max(_FEWEST_STEPS, len(near) / 2):
        near[:] = False
    return steps[near], turned[near]


def _unit_since_1970(times: NDArray[Any]) -> TimeUnit | None:
    first, last = float(times.min()), float(times.max())
    for unit, ticks in PER_SECOND.items():
        is_of_day = last - first <= _DAY_S * ticks
        if is_of_day and _YEAR_2000_S * ticks <= first and last < _YEAR_2100_S * ticks:
            return unit
    return None

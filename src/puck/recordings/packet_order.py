"""Sorting of data packets, and warnings of packets that are late or lost, and of leaps.

A sensor sends packets at equal intervals of its clock, and its azimuth rises at one rate. A leap is
a sudden change of the clock or of the azimuth.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.returns import HOUR_US
from pointkit.lidar.turns import CENTIDEGREES, clock_steps
from puck.recordings.ouster import OusterSensor, numbered_columns
from puck.recordings.packets import PACKET, PacketLog

_LEAP_US = 5e5
"""Smallest step of a clock, in us, that is a leap. Later packets are not sorted."""
_FEWEST_STEPS = 15
"""Least number of steps between packets from which the usual step is estimated."""
_MOST_USUAL, _MOST_OFF = 1.5, 0.5
"""Limits of usual times between packets and of the rotation rate's deviation.

Both are relative to the medians.
"""
_RECEIVED_ALIKE = 0.1
"""Limit of the difference between a step of the clock and the time between receptions.

The limit is a share of the step. Below it, a large step is a pause, not a leap.
"""


def in_order(log: PacketLog) -> PacketLog:
    """Return a Velodyne's packets sorted by the sensor's clock, except where the clock leaps.

    The result's `about` counts the packets that were late.
    """
    steps = clock_steps(_clock_us(log), HOUR_US)
    is_leap = np.abs(steps) >= _LEAP_US
    late = int(((steps < 0) & ~is_leap).sum())
    if not late:
        return log
    elapsed, leaps = (np.append(0, np.cumsum(each)) for each in (steps, is_leap))
    rows = np.lexsort((elapsed, leaps))
    payloads, received = log.payloads[rows], log.received[rows]
    return replace(
        log, payloads=payloads, received=received, about={**log.about, "late_packets": late}
    )


def tell_irregularities(source: Path, log: PacketLog) -> None:
    """Log warnings about packets that are late or lost, and about leaps of clock or azimuth.

    Raises InputError if the azimuth falls. The warnings name the file `source`.
    """
    told = []
    if late := log.about.get("late_packets"):
        told.append(f"sorted by the sensor's clock, as {late:,} packets are late")
    told += _of_velodyne(log) if log.sensor is None else _of_ouster(log.sensor, log.payloads)
    back = np.diff(log.received) * 1e6 <= -_LEAP_US
    if back.any():
        told.append(f"times of reception go back ({_first(back, len(log))})")
    for line in told:
        logging.getLogger(__name__).warning("%s: %s", source, line)


def _of_velodyne(log: PacketLog) -> list[str]:
    steps = clock_steps(_clock_us(log), HOUR_US)
    if len(steps) < _FEWEST_STEPS:
        return []
    if not steps.any():
        return ["the sensor's clock stands still: points have no times"]
    usual = float(np.median(steps[steps > 0]))
    apart_us = np.diff(log.received) * 1e6
    is_pause = np.abs(apart_us - steps) < _RECEIVED_ALIKE * np.abs(steps)
    is_leap = (np.abs(steps) >= _LEAP_US) & ~is_pause
    is_gap = (steps > _MOST_USUAL * usual) & ~is_leap
    lost = int((np.rint(steps[is_gap] / usual) - 1).sum())
    told = []
    if lost:
        told.append(f"about {lost:,} packets are lost ({_first(is_gap, len(steps) + 1)})")
    if is_leap.any():
        leap_s = steps[np.argmax(is_leap)] * 1e-6
        told.append(f"the sensor's clock leaps ({_first(is_leap, len(steps) + 1)}: {leap_s:.6g} s)")
    return [*told, *_of_rotation(log, steps, usual)]


def _of_rotation(log: PacketLog, steps: Floats, usual: float) -> list[str]:
    azimuths = _viewed(log)["blocks"]["azimuth"][:, 0].astype(np.float64)
    half = CENTIDEGREES // 2
    rises = (np.mod(np.diff(azimuths) + half, CENTIDEGREES) - half) / 100
    is_usual = (steps > usual / _MOST_USUAL) & (steps < usual * _MOST_USUAL)
    if is_usual.sum() < _FEWEST_STEPS:
        return []
    rates = np.divide(rises, steps, out=np.zeros(len(steps)), where=is_usual)
    rate = float(np.median(rates[is_usual]))
    if rate < 0:
        raise InputError("the azimuths of its packets fall, where those of a Velodyne rise")
    if rate == 0:
        return ["the sensor does not turn: the azimuths of its packets do not rise"]
    is_off = is_usual & (np.abs(rates - rate) > _MOST_OFF * rate)
    if not is_off.any():
        return []
    rise = f"{rises[np.argmax(is_off)]:.2f} degrees"
    hertz = f"{rate / 360 * 1e6:.3g} Hz"
    return [
        f"the azimuth rises unevenly, not at {hertz} ({_first(is_off, len(steps) + 1)}: {rise})"
    ]


def _of_ouster(sensor: OusterSensor, payloads: NDArray[np.uint8]) -> list[str]:
    frames, columns = numbered_columns(sensor, payloads)
    if not len(frames):
        return []
    keys, rows = np.unique(frames * sensor.columns + columns["column"], return_index=True)
    told = []
    if repeated := len(frames) - len(keys):
        told.append(f"left out {repeated:,} columns that repeat one before")
    numbers, counts = np.unique(keys // sensor.columns, return_counts=True)
    lacking = np.maximum(sensor.whole - counts[1:-1], 0)
    if lost := int(lacking.sum() + sensor.whole * (np.diff(numbers) - 1).sum()):
        told.append(f"{lost:,} columns are lost within {int(numbers[-1] - numbers[0] + 1)} turns")
    steps_s = np.diff(columns["time"][rows].astype(np.int64)) * 1e-9
    is_leap = (np.abs(steps_s) >= _LEAP_US * 1e-6) & (np.diff(keys // sensor.columns) <= 1)
    if is_leap.any():
        told.append(f"the sensor's clock leaps by {steps_s[np.argmax(is_leap)]:.6g} s")
    return told


def _first(rows: NDArray[np.bool_], packets: int) -> str:
    places = f"at {int(rows.sum()):,} of {packets:,} packets, first" if rows.sum() > 1 else "at"
    return f"{places} packet {int(np.argmax(rows)) + 1:,}"


def _viewed(log: PacketLog) -> NDArray[Any]:
    return np.ascontiguousarray(log.payloads).view(PACKET)[:, 0]


def _clock_us(log: PacketLog) -> Floats:
    return _viewed(log)["time_us"].astype(np.float64)

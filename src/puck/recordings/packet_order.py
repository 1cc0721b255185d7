"""Sorting of data packets, warnings of packets that are late or lost, and of leaps.

A sensor sends packets at equal intervals of its clock, and its azimuth rises at one rate. A leap is
a sudden change of the clock or of the azimuth. Clocks leap when GPS or PTP sets them; the sensor
measures on meanwhile, so that its times must go on without the leap.
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
from pointkit.lidar.turns import CENTIDEGREES
from puck.recordings.clock_leaps import (
    FEWEST_STEPS,
    LEAP_US,
    MOST_OFF,
    MOST_USUAL,
    Motion,
    clock_epochs,
    find_leaps,
    motion_of,
)
from puck.recordings.ouster import OusterSensor, numbered_columns, window_places
from puck.recordings.ouster_logs import unknown_facts
from puck.recordings.packets import PACKET, PacketLog

_MOST_PLACES = 1 << 13
"""Maximum number of places by which sorting may move a packet. This is more packets than a sensor
sends in 0.5 s, which is the longest delay that is sorted."""


def sorted_rows(motion: Motion) -> NDArray[np.intp] | None:
    """Return the order of packets by the sensor's clock, which is kept where the clock leaps.

    Parameters
    ----------
    motion
        Clock and rotation of the sensor between the packets, of which there are p.

    Returns
    -------
    array (p,) or None
        Indices of the packets in the order of the clock; None if the packets are in this order, or
        so far from it that the clock is none, as when few packets are sent again and again.
    """
    if not (motion.steps_us < 0).any():
        return None
    elapsed = np.append(0, np.cumsum(motion.steps_us))
    rows = np.lexsort((elapsed, clock_epochs(motion, find_leaps(motion))))
    moved = np.abs(rows - np.arange(len(rows))).max()
    return rows if 0 < moved <= _MOST_PLACES else None


def is_regular(log: PacketLog) -> bool:
    """Return whether the clock never falls, and has no step that may be a leap."""
    motion = _motion(log)
    return bool((motion.steps_us >= 0).all() and not find_leaps(motion).any())


def in_order(log: PacketLog) -> PacketLog:
    """Return packets sorted by the sensor's clock, except where the clock leaps.

    The result's `about` counts the packets that were late.
    """
    motion = _motion(log)
    rows = sorted_rows(motion)
    if rows is None:
        return log
    passed = np.diff(clock_epochs(motion, find_leaps(motion)))
    late = int(((passed < 0) | (passed == 0) & (motion.steps_us < 0)).sum())
    payloads, received = log.payloads[rows], log.received[rows]
    return replace(
        log, payloads=payloads, received=received, about={**log.about, "late_packets": late}
    )


def without_leaps(log: PacketLog) -> PacketLog:
    """Return packets whose clock does not leap.

    Where it leaps by 0.5 s or more, the time between two packets becomes the time between their
    receptions or, if this is not plausible, the usual time. Where it leaps by less, it becomes the
    usual time. The largest clock is kept, and the others are put forward.
    """
    motion = _motion(log)
    steps, is_leap = motion.steps_us, find_leaps(motion, log.received)
    if not is_leap.any():
        return log
    is_usual = (steps > 0) & ~is_leap
    usual = float(np.median(steps[is_usual])) if is_usual.any() else 0.0
    apart_us = np.diff(log.received) * 1e6
    is_plausible = (apart_us > usual) & (apart_us < LEAP_US)
    run_on = np.where(is_plausible & (np.abs(steps) >= LEAP_US), apart_us, usual)
    leapt = np.append(0, np.cumsum(np.where(is_leap, steps - run_on, 0)))
    forward_us = np.rint(leapt.max() - leapt).astype(np.int64)
    payloads = log.payloads.copy()
    packets = _viewed(replace(log, payloads=payloads))
    if log.sensor is None:
        packets["time_us"] = (packets["time_us"].astype(np.int64) + forward_us) % HOUR_US
    else:
        times = packets["columns"]["time"]
        forward_us = _of_columns(times, forward_us, np.flatnonzero(is_leap))
        packets["columns"]["time"] = times + 1000 * forward_us.astype(np.uint64)
    return replace(log, payloads=payloads)


def _of_columns(
    times: NDArray[np.uint64], forward_us: NDArray[np.int64], leaps: NDArray[np.intp]
) -> NDArray[np.int64]:
    """Return by how much columns (p, c) are put forward if the clock leaps after packets `leaps`.

    If it leaps within such a packet, the columns after the leap are put forward like the next
    packet.
    """
    of_columns = np.repeat(forward_us[:, None], times.shape[1], axis=1)
    for packet in leaps.tolist():
        steps_us = np.diff(times[packet].astype(np.int64)) / 1000
        off = np.abs(steps_us - np.median(steps_us))
        if len(off) and off.max() > abs(forward_us[packet + 1] - forward_us[packet]) / 2:
            of_columns[packet, int(np.argmax(off)) + 1 :] = forward_us[packet + 1]
    return of_columns


def tell_irregularities(source: Path, log: PacketLog) -> None:
    """Log warnings about packets that are late or lost, and about leaps of clock or azimuth.

    Other warnings tell what an Ouster's metadata leave open. InputError is raised if the azimuth
    falls. The warnings name the file `source`.
    """
    told = []
    if late := log.about.get("late_packets"):
        are_late = f"{late:,} packets are" if late > 1 else "1 packet is"
        told.append(f"sorted by the sensor's clock, as {are_late} late")
    if log.sensor is None:
        told += _of_velodyne(log)
    else:
        told += [*unknown_facts(log.sensor), *_of_ouster(log.sensor, log)]
    back = np.diff(log.received) * 1e6 <= -LEAP_US
    if back.any():
        told.append(f"times of reception go back ({_first(back, len(log))})")
    for line in told:
        logging.getLogger(__name__).warning("%s: %s", source, line)


def _of_velodyne(log: PacketLog) -> list[str]:
    steps, is_leap = _steps_and_leaps(log)
    if len(steps) < FEWEST_STEPS:
        return []
    if not steps.any():
        return ["the sensor's clock stands still: points have no times"]
    usual = float(np.median(steps[steps > 0]))
    is_gap = (steps > MOST_USUAL * usual) & ~is_leap
    lost = int((np.rint(steps[is_gap] / usual) - 1).sum())
    told = []
    if lost:
        told.append(f"about {lost:,} packets are lost ({_first(is_gap, len(steps) + 1)})")
    return [*told, *_of_leaps(steps, is_leap), *_of_rotation(log, steps, usual)]


def _of_rotation(log: PacketLog, steps: Floats, usual: float) -> list[str]:
    azimuths = _viewed(log)["blocks"]["azimuth"][:, 0].astype(np.float64)
    half = CENTIDEGREES // 2
    rises = (np.mod(np.diff(azimuths) + half, CENTIDEGREES) - half) / 100
    is_usual = (steps > usual / MOST_USUAL) & (steps < usual * MOST_USUAL)
    if is_usual.sum() < FEWEST_STEPS:
        return []
    rates = np.divide(rises, steps, out=np.zeros(len(steps)), where=is_usual)
    rate = float(np.median(rates[is_usual]))
    if rate < 0:
        raise InputError("the azimuths of its packets fall, where those of a Velodyne rise")
    if rate == 0:
        return ["the sensor does not turn: the azimuths of its packets do not rise"]
    is_off = is_usual & (np.abs(rates - rate) > MOST_OFF * rate)
    if not is_off.any():
        return []
    rise = f"{rises[np.argmax(is_off)]:.2f} degrees"
    hertz = f"{rate / 360 * 1e6:.3g} Hz"
    return [
        f"the azimuth rises unevenly, not at {hertz} ({_first(is_off, len(steps) + 1)}: {rise})"
    ]


def _of_ouster(sensor: OusterSensor, log: PacketLog) -> list[str]:
    frames, columns = numbered_columns(sensor, log.payloads)
    places = window_places(sensor, columns["column"])
    is_in_window = (places >= 0) & (places < sensor.whole)
    places = (frames * sensor.whole + places)[is_in_window]
    present, told = np.unique(places), list[str]()
    if repeated := len(places) - len(present):
        told.append(f"left out {repeated:,} columns that repeat one before")
    if lost := int(np.ptp(present)) + 1 - len(present) if len(present) else 0:
        turns = int(frames.max() - frames.min()) + 1
        told.append(f"{lost:,} columns are lost within {turns:,} turn{'s' * (turns > 1)}")
    return [*told, *_of_leaps(*_steps_and_leaps(log))]


def _of_leaps(steps: Floats, is_leap: NDArray[np.bool_]) -> list[str]:
    if not is_leap.any():
        return []
    leap = f"{_first(is_leap, len(steps) + 1)}: {steps[np.argmax(is_leap)] * 1e-6:.6g} s"
    return [f"the sensor's clock leaps ({leap}); times go on without the leap"]


def _first(rows: NDArray[np.bool_], packets: int) -> str:
    places = f"at {int(rows.sum()):,} of {packets:,} packets, first" if rows.sum() > 1 else "at"
    return f"{places} packet {int(np.argmax(rows)) + 1:,}"


def _viewed(log: PacketLog) -> NDArray[Any]:
    return log.payloads.view(log.sensor.packet if log.sensor else PACKET)[:, 0]


def _steps_and_leaps(log: PacketLog) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the steps of the clock between packets, in us, and which of them are leaps."""
    motion = _motion(log)
    return motion.steps_us, find_leaps(motion, log.received)


def _motion(log: PacketLog) -> Motion:
    if log.sensor is None:
        return motion_of(log.payloads, PACKET)
    return motion_of(log.payloads, log.sensor.packet, log.sensor.columns)

"""Times of points in ROS clouds (PointCloud2), which drivers store with different units and
origins.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.times import (
    PER_SECOND,
    TimeUnit,
    are_shares,
    falls,
    fault_of,
    is_since_1970,
    largest_leap,
    unit_of,
)
from puckbench.recordings.decoded_clouds import TIMES, Columns, check_finite

_UNITS: dict[str, TimeUnit] = {"t": "ns", "offset_time": "ns"}
"""Units of the time fields of Ouster and Livox, used if the unit cannot be inferred."""
_LONGEST_TURN_S = 1.0
_MOST_APART = 1.5
"""Largest time between messages, and largest duration of a message, as multiples of the usual time
between messages.
"""
_log = logging.getLogger(__name__)


class MessagePoints(NamedTuple):
    """The points of one message of a ROS topic of clouds.

    Parameters
    ----------
    number
        Number of the message in its topic, from 0.
    stamp_ns
        Time in the message's header, in ns.
    frame
        Name of the coordinate frame.
    columns
        Values of the points, (n,), by name. Coordinates are those of ROS: x forward, y left, z up.
    """

    number: int
    stamp_ns: int
    frame: str
    columns: Columns


def time_field(columns: Columns) -> str | None:
    """Return the name of the column that contains the times of the points, or None."""
    return next((name for name in TIMES if name in columns), None)


def seconds_of_messages(
    messages: Sequence[MessagePoints],
    unit: TimeUnit | None,
    label: str,
    apart_s: float | None = None,
) -> tuple[list[Floats], bool]:
    """Return when the points of messages were measured, relative to the first message.

    Times of points are counted from the time stamp of their message. If they increase from message
    to message, they are counted from the earliest point of the first message instead. Shares of a
    turn are multiplied by the usual time between messages. If the messages have no usable times,
    all points of a message get the time of its stamp.

    Parameters
    ----------
    messages
        Messages of one topic.
    unit
        Unit of the points' times; None if it is to be inferred.
    label
        Text with which warnings begin. There are warnings of unusable times, and of messages that
        are lost, late or out of order.
    apart_s
        Usual time between messages, in s; by default, the stamps tell it.

    Returns
    -------
    seconds
        Times of the points of each message, (n,), in s.
    are_timed
        Whether the messages have usable times of points.

    Raises
    ------
    InputError
        A time is not finite, or its unit cannot be inferred.
    """
    stamps_s = np.array([(each.stamp_ns - messages[0].stamp_ns) / 1e9 for each in messages])
    name = time_field(messages[0].columns)
    apart_s = _usual_step(stamps_s) or apart_s
    times = None if name is None else _usable(messages, name, unit, apart_s, label)
    if times is None:
        _tell_order(messages, stamps_s, label, "stamps")
        stamped = zip(messages, stamps_s, strict=True)
        return [np.full(len(each.columns["x"]), stamp) for each, stamp in stamped], False
    is_absolute, parts = times
    begins = np.array([part.min() for part in parts]) if is_absolute else stamps_s
    _tell_order(messages, begins, label, f"times in field {name}" if is_absolute else "stamps")
    if not is_absolute:
        parts = [part + stamp for part, stamp in zip(parts, stamps_s, strict=True)]
    _tell_leaps(messages, parts, label, str(name))
    return parts, True


def _usable(
    messages: Sequence[MessagePoints],
    name: str,
    unit: TimeUnit | None,
    apart_s: float | None,
    label: str,
) -> tuple[bool, list[Floats]] | None:
    """Return whether all times share one origin, and the times in s; None if they are unusable."""
    times = [_signed(each.columns[name]) for each in messages]
    for part in times:
        check_finite(f"field {name}", part)
    largest = max(range(len(times)), key=lambda k: len(times[k]))
    sample, columns = times[largest], messages[largest].columns
    azimuth = np.arctan2(-columns["y"], columns["x"])
    if unit is None and apart_s and apart_s < _LONGEST_TURN_S and are_shares(sample, azimuth):
        told = (label, name, sample.min(), sample.max(), apart_s)
        _log.warning("%s: field %s has shares of a turn (%g to %g), taken as shares of %g s", *told)
        return False, [np.asarray(part * apart_s, dtype=np.float64) for part in times]
    inferred = unit or unit_of(sample, azimuth, apart_s) or _UNITS.get(name)
    if inferred is None:
        raise InputError(f"the unit of field {name} cannot be inferred: add --time-unit ns")
    ticks, is_absolute = PER_SECOND[inferred], _is_absolute(times, inferred)
    fault = fault_of(sample, inferred, None if unit else azimuth)
    if fault is None and unit is None and apart_s:
        span_s = float(np.median([np.ptp(part) for part in times])) / ticks
        if span_s > _MOST_APART * apart_s:
            fault = (
                f"has times of {span_s:g} s in a message, though messages are {apart_s:g} s apart"
            )
    if fault:
        _log.warning("%s: field %s %s: its times are left out", label, name, fault)
        return None
    if falls(sample):
        _log.warning("%s: field %s has times that fall from point to point", label, name)
    origin = times[0].min() if is_absolute else 0
    return is_absolute, [np.asarray((part - origin) / ticks, dtype=np.float64) for part in times]


def _is_absolute(times: Sequence[NDArray[Any]], unit: TimeUnit) -> bool:
    """Return whether the times of all messages count from one origin.

    They do if they are dates, if they are larger than the duration of a turn, or if they increase
    from message to message. Otherwise, they count from the beginning of each message.
    """
    if is_since_1970(times[0], unit):
        return True
    firsts = np.array([part.min() for part in times])
    if np.abs(firsts).max() > _LONGEST_TURN_S * PER_SECOND[unit]:
        return True
    steps, spans = np.diff(firsts), [np.ptp(part) for part in times]
    return len(steps) > 0 and bool(np.median(steps) > np.median(spans) / 2)


def _usual_step(begins_s: Floats) -> float | None:
    steps = np.diff(begins_s)
    return float(np.median(steps[steps > 0])) if (steps > 0).any() else None


def _tell_order(
    messages: Sequence[MessagePoints], begins_s: Floats, label: str, of_what: str
) -> None:
    steps, usual = np.diff(begins_s), _usual_step(begins_s)
    faults = {"do not follow": steps <= 0}
    if usual:  # messages without a point are not among `messages`, and no gap
        apart = np.diff([each.number for each in messages])
        faults["leave gaps"] = steps > (apart - 1 + _MOST_APART) * usual
    for fault, rows in faults.items():
        if rows.any():
            first = int(np.argmax(rows))
            step = f"{steps[first]:.6g} s to message {messages[first + 1].number}"
            more = f", usually {usual:.3g} s" if usual else ""
            told = (label, int(rows.sum()), len(messages), fault, of_what, step, more)
            _log.warning("%s: %d of %d messages %s by their %s (first %s%s)", *told)


def _tell_leaps(
    messages: Sequence[MessagePoints], parts: Sequence[Floats], label: str, name: str
) -> None:
    leaps = [largest_leap(part) for part in parts]
    found = [number for number, leap in enumerate(leaps) if leap]
    if found and (leap := leaps[found[0]]):
        told = (label, name, leap[0], messages[found[0]].number, len(found), len(messages))
        _log.warning("%s: field %s leaps by %.6g s in message %d (%d of %d leap)", *told)


def _signed(times: NDArray[Any]) -> NDArray[Any]:
    return times.astype(np.int64 if times.dtype.kind in "iu" else times.dtype)

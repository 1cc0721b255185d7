from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError, counted, naming
from pointkit.geometry.cloud import Floats, check_points
from pointkit.isolated import Columns
from pointkit.lidar.return_table import ReturnTable
from pointkit.lidar.sensor import Sensor
from pointkit.lidar.times import TimeUnit
from pointkit.lidar.turns import MAX_LASERS
from puckbench.recordings.cloud_messages import cloud_topic, read_cloud_messages
from puckbench.recordings.decoded_clouds import (
    LASERS,
    REFLECTIVITIES,
    check_finite,
    returns_of_columns,
    tell_missing,
    without_missing,
)
from puckbench.recordings.fitted_lasers import fitted_lasers
from puckbench.recordings.message_times import MessagePoints, seconds_of_messages, time_field
from puckbench.recordings.table_turns import MOST_RING

_BATCH = 64
_log = logging.getLogger(__name__)


def read_message_returns(
    path: Path,
    topic: str | None,
    sensor: Sensor | None,
    time_unit: TimeUnit | None = None,
    source: Path | None = None,
) -> ReturnTable:
    """Read the clouds of a ROS topic as a table of returns, with one turn for each message.

    The clouds must have the coordinates of ROS: x forward, y left, z up. The table has the
    sensor's: x right, y forward, z up. `message_times.seconds_of_messages` describes how times are
    read, and `decoded_clouds.returns_of_columns` describes the other columns.

    Parameters
    ----------
    path
        A ROS bag.
    topic
        Topic of clouds; None for the only one.
    sensor
        The sensor. If it is None, lasers are fitted to the points.
    time_unit
        Unit of the points' times; by default, it is inferred.
    source
        File that warnings name, if `path` is a temporary copy of it.

    Returns
    -------
    ReturnTable
        A row for each point.

    Raises
    ------
    InputError
        The messages have no points or lasers, or come from several sensors.
    """
    name, (_, count) = cloud_topic(path, topic)
    label = f"{source or path}: topic {name}"
    with naming(label):
        points, counts = _read(path, name, range(count), time_unit, label)
        columns = {**points, "x": -points["y"], "y": points["x"]}
        about: dict[str, Any] = {}
        if sensor is None:
            columns, sensor, about = _fitted(columns, label)
        table = returns_of_columns(columns, columns["timestamp"], sensor, label)
    since = table["timestamp"] - table["timestamp"].min(initial=math.inf)
    about = {"format": path.suffix[1:].lower(), **counts, **about, "topic": name, "messages": count}
    columns = {**table.columns, "timestamp": since}
    return replace(table, columns=columns, about={**table.about, **about})


def read_message_columns(
    path: Path,
    topic: str | None,
    turns: tuple[int, int],
    time_unit: TimeUnit | None = None,
    source: Path | None = None,
) -> Columns:
    """Read the points of several messages of a ROS topic as columns.

    Points without coordinates are left out. `message_times.seconds_of_messages` describes how times
    are read.

    Parameters
    ----------
    path
        A ROS bag.
    topic
        Topic of clouds; None for the only one.
    turns
        Numbers of the first and the last message to read, from 0.
    time_unit
        Unit of the points' times; by default, it is inferred.
    source
        File that warnings name, if `path` is a temporary copy of it.

    Returns
    -------
    dict
        Values, (n,), by name: ``x``, ``y``, ``z`` in m and, if the messages have them, ``ring``,
        ``intensity``, and ``time`` in s.

    Raises
    ------
    InputError
        There are no such messages, they have no points, or they come from several sensors.
    """
    name, (_, count) = cloud_topic(path, topic)
    first, last = turns
    label = f"{source or path}: topic {name}"
    with naming(label):
        _check_numbers(first, last, count)
        apart_s = _time_between(path, name, last, count) if first == last else None
        columns, _ = _read(path, name, range(first, last + 1), time_unit, label, apart_s)
    return _named(columns, columns["timestamp"] if columns["timed"].all() else None)


def iterate_messages(
    path: Path,
    topic: str | None,
    turns: tuple[int, int] | None,
    time_unit: TimeUnit | None = None,
    source: Path | None = None,
) -> Iterator[tuple[float, Columns]]:
    """Yield the points of each message of a ROS topic, as `read_message_columns` reads them.

    Parameters
    ----------
    path
        A ROS bag.
    topic
        Topic of clouds; None for the only one.
    turns
        Numbers of the first and the last message, from 0; by default, all messages.
    time_unit
        Unit of the points' times; by default, it is inferred.
    source
        File that warnings name, if `path` is a temporary copy of it.

    Yields
    ------
    seconds
        Time of the message's first point, or of its stamp if points have no times, in s since the
        origin of stamps.
    columns
        Values, (n,), by name; ``time`` counts from `seconds`. Messages without a point are left
        out.

    Raises
    ------
    InputError
        There are no such messages, or they come from several sensors.
    """
    name, (_, count) = cloud_topic(path, topic)
    first, last = turns or (0, count - 1)
    label = f"{source or path}: topic {name}"
    with naming(label):
        _check_numbers(first, last, count)
        before, begin_s, missing = list[MessagePoints](), 0.0, 0
        for start in range(first, last + 1, _BATCH):
            found = list(_messages(path, name, range(start, min(start + _BATCH, last + 1))))
            missing += sum(left_out for _, left_out in found)
            full = [message for message, _ in found if len(message.columns["x"])]
            if not full:
                continue
            _check_alike([*before, *full])  # the last one of the batch before places this batch
            seconds, are_timed = seconds_of_messages([*before, *full], time_unit, label)
            origin = begin_s - seconds[0].min() if before else full[0].stamp_ns / 1e9
            for message, times in zip(full, seconds[len(before) :], strict=True):
                begin_s = origin + float(times.min())
                since = times - times.min() if are_timed else None
                yield begin_s, _named(message.columns, since)
            before = full[-1:]
    tell_missing(label, missing)


def _check_numbers(first: int, last: int, count: int) -> None:
    if not count:
        raise InputError("has no messages")
    if not 0 <= first <= last < count:
        raise InputError(f"has messages 0 to {count - 1}, not {first} to {last}")


def _named(columns: Mapping[str, NDArray[Any]], seconds: Floats | None) -> Columns:
    """Return coordinates, rings, intensities and times of points under these names."""
    result = {axis: columns[axis] for axis in "xyz"}
    for name, fields in (("ring", LASERS[::-1]), ("intensity", REFLECTIVITIES)):
        present = [columns[field] for field in fields if field in columns]
        result |= {name: present[0]} if present else {}
    return result | ({} if seconds is None else {"time": seconds})


def _time_between(path: Path, topic: str, number: int, count: int) -> float | None:
    """Return the time from a message to the next or from the one before, in s, by their stamps."""
    first = min(number, count - 2)
    if first < 0:
        return None
    one, other = read_cloud_messages(path, topic, [first, first + 1])
    return max(other.stamp_ns - one.stamp_ns, 0) / 1e9 or None


def _read(
    path: Path,
    topic: str,
    numbers: Sequence[int],
    unit: TimeUnit | None,
    label: str,
    apart_s: float | None = None,
) -> tuple[Columns, dict[str, int]]:
    """Read the points of messages without missing returns, and count the missing returns."""
    messages, missing = [], 0
    for message, left_out in _messages(path, topic, numbers):
        if len(message.columns["x"]):
            messages.append(message)
            missing += left_out
    if not messages:
        raise InputError("no points in its messages")
    if empty := len(numbers) - len(messages):
        _log.warning("%s: left out %s without a point", label, counted(empty, "message"))
    counts = tell_missing(label, missing)
    _check_alike(messages)
    seconds, are_timed = seconds_of_messages(messages, unit, label, apart_s)
    names = [each for each in messages[0].columns if each != time_field(messages[0].columns)]
    columns = {each: np.concatenate([part.columns[each] for part in messages]) for each in names}
    sizes = [len(part) for part in seconds]
    columns["timestamp"] = np.concatenate(seconds)
    columns["timed"] = np.full(sum(sizes), are_timed)
    columns["turn"] = np.repeat(np.array([each.number for each in messages], np.int32), sizes)
    return columns, counts


def _messages(
    path: Path, topic: str, numbers: Sequence[int]
) -> Iterator[tuple[MessagePoints, int]]:
    """Yield the points of each message without missing returns, and how many were missing."""
    for first in range(0, len(numbers), _BATCH):
        batch = numbers[first : first + _BATCH]
        for number, message in zip(batch, read_cloud_messages(path, topic, batch), strict=True):
            columns = message.columns
            kept = (*"xyz", *LASERS, *REFLECTIVITIES, time_field(columns))
            columns = {name: part for name, part in columns.items() if name in kept}
            present, missing = without_missing(columns, "field")
            yield MessagePoints(number, message.stamp_ns, message.frame, present), missing


def _check_alike(messages: Sequence[MessagePoints]) -> None:
    """Raise InputError if messages differ in frame or fields, as those of several sensors do."""
    first = messages[0]
    for each in messages:
        if each.frame != first.frame:
            fault = f"is in frame {each.frame!r}, message {first.number} in {first.frame!r}"
        elif differing := sorted(each.columns.keys() ^ first.columns.keys()):
            fault = f"and message {first.number} differ in the fields {', '.join(differing)}"
        else:
            continue
        raise InputError(f"message {each.number} {fault}: several sensors in one topic?")


def _fitted(columns: Columns, label: str) -> tuple[Columns, Sensor, dict[str, Any]]:
    name = next((each for each in LASERS[::-1] if each in columns), None)
    if name is None:
        raise InputError(f"no laser column ({', '.join(LASERS)})")
    ring = columns[name]
    check_finite(f"field {name}", ring)
    if (count := len(np.unique(ring))) > MAX_LASERS:
        raise InputError(f"field {name} has {count:,} numbers, more than {MAX_LASERS} lasers")
    if (ring != np.floor(ring)).any():
        raise InputError(f"field {name} has {ring[ring != np.floor(ring)][0]:g}, no laser's number")
    xyz = np.column_stack([columns[axis] for axis in "xyz"]).astype(np.float64)
    check_points(xyz, label)
    fitted = fitted_lasers(xyz, ring, columns["timestamp"], columns["turn"])
    rest = {each: values[fitted.is_used] for each, values in columns.items() if each not in LASERS}
    rest["ring"] = fitted.ranks[fitted.is_used]
    about = {**fitted.about(), **_rings(ring[fitted.is_used], rest["ring"])}
    left_out = about.get("points_left_out")
    if isinstance(left_out, int) and left_out:
        points = counted(left_out, "point")
        _log.warning("%s: left out %s of lasers with few points", label, points)
    return rest, fitted.sensor, about


def _rings(numbers: NDArray[Any], ranks: NDArray[np.intp]) -> dict[str, list[int]]:
    """Return the message's number of each laser, if the numbers ascend with the elevation."""
    lasers, first = np.unique(ranks, return_index=True)
    found = numbers[first].astype(np.int64)
    is_rank = (np.diff(found) > 0).all() and found[0] >= 0 and found[-1] <= MOST_RING
    return {"rings": found.tolist()} if is_rank and len(lasers) == lasers[-1] + 1 else {}

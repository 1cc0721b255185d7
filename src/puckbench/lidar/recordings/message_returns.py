from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError, naming
from puckbench.geometry.cloud import Floats, check_points
from puckbench.io.point_columns import Columns
from puckbench.lidar.recordings.cloud_messages import (
    CloudMessage,
    cloud_topic,
    read_cloud_messages,
)
from puckbench.lidar.recordings.decoded_clouds import (
    LASERS,
    REFLECTIVITIES,
    TIMES,
    returns_of_columns,
    without_missing,
)
from puckbench.lidar.recordings.fitted_lasers import fitted_lasers
from puckbench.lidar.recordings.returns import RecordedReturns
from puckbench.lidar.recordings.times import PER_SECOND, TimeUnit, is_since_1970, unit_of
from puckbench.lidar.sensor import Sensor

_BATCH = 64
_UNITS: dict[str, TimeUnit] = {"t": "ns", "offset_time": "ns"}
"""Units of Ouster's and Livox's time fields, for times whose unit cannot be inferred."""


def read_message_returns(
    path: Path, topic: str | None, sensor: Sensor | None, time_unit: TimeUnit | None = None
) -> RecordedReturns:
    """Read a topic of clouds as a table of returns, with a turn for each message.

    The clouds' coordinates are those of ROS: x forward, y left, z up. Their times count from the
    message's stamp, or from 1970; for columns see `puckbench.lidar.recordings.decoded_clouds`. If
    `sensor` is None, lasers are fitted to the points.
    """
    name, (_, count) = cloud_topic(path, topic)
    with naming(f"{path}: topic {name}"):
        points = _joined(_parts(path, name, range(count), time_unit))
        columns = {**points, "x": -points["y"], "y": points["x"]}
        about: dict[str, Any] = {}
        if sensor is None:
            columns, sensor, about = _fitted(path, columns)
        table = returns_of_columns(columns, sensor, "s", path)
    seconds = table["timestamp"] - table["timestamp"].min(initial=math.inf)
    about = {**table.about, **about, "topic": name, "messages": count}
    return replace(table, columns={**table.columns, "timestamp": seconds}, about=about)


def _fitted(path: Path, columns: Columns) -> tuple[dict[str, NDArray[Any]], Sensor, dict[str, Any]]:
    name = next((each for each in LASERS[::-1] if each in columns), None)
    if name is None:
        raise InputError(f"no laser column ({', '.join(LASERS)})")
    present, counts = without_missing(path, columns)
    xyz = np.column_stack([present[axis] for axis in "xyz"]).astype(np.float64)
    check_points(xyz, str(path))
    fitted = fitted_lasers(xyz, present[name], present["timestamp"], present["turn"])
    rest = {each: values[fitted.is_used] for each, values in present.items() if each not in LASERS}
    rest["ring"] = fitted.ranks[fitted.is_used]
    return rest, fitted.sensor, {**counts, **fitted.about()}


def read_message_columns(
    path: Path, topic: str | None, turns: tuple[int, int], time_unit: TimeUnit | None = None
) -> Columns:
    """Read the points of messages: x, y, z in m, and ring, intensity and time in s if they exist.

    Times are relative to the first message's stamp or, if counted since 1970, to that message's
    first time. Points without coordinates are left out.
    """
    name, (_, count) = cloud_topic(path, topic)
    first, last = turns
    with naming(f"{path}: topic {name}"):
        if not 0 <= first <= last < count:
            raise InputError(f"has messages 0 to {count - 1}, not {first} to {last}")
        parts = _parts(path, name, range(first, last + 1), time_unit)
        columns, _ = without_missing(path, _joined(parts))
    result = {axis: columns[axis] for axis in "xyz"}
    for name, fields in (("ring", LASERS[::-1]), ("intensity", REFLECTIVITIES)):
        present = [columns[field] for field in fields if field in columns]
        result |= {name: present[0]} if present else {}
    return result | ({"time": columns["timestamp"]} if columns["timed"].all() else {})


def _joined(parts: Iterator[Columns]) -> Columns:
    listed = list(parts)
    if not listed:
        raise InputError("no points in its messages")
    names = set.intersection(*map(set, listed))
    return {each: np.concatenate([part[each] for part in listed]) for each in sorted(names)}


@dataclass(frozen=True)
class _Clock:
    """Conversion of times to s since the first message or, for times since 1970, since `origin`."""

    column: str
    unit: TimeUnit
    start_ns: int
    origin: float | None

    def seconds(self, message: CloudMessage, columns: Columns) -> Floats:
        since = (message.stamp_ns - self.start_ns) / 1e9
        if self.column not in columns:
            return np.full(len(columns["x"]), since)
        times, ticks = _signed(columns[self.column]), PER_SECOND[self.unit]
        if self.origin is None:
            return np.asarray(times / ticks + since, dtype=np.float64)
        return np.asarray((times - self.origin) / ticks, dtype=np.float64)


def _parts(
    path: Path, topic: str, messages: Sequence[int], unit: TimeUnit | None
) -> Iterator[Columns]:
    clock: _Clock | None = None
    for first in range(0, len(messages), _BATCH):
        numbers = messages[first : first + _BATCH]
        for number, message in zip(numbers, read_cloud_messages(path, topic, numbers), strict=True):
            columns = message.columns
            present = _present(columns)
            if not len(present["x"]):
                continue
            clock = clock or _clock(message, present, unit)
            kept = {name: columns[name] for name in (*LASERS, *REFLECTIVITIES) if name in columns}
            yield {
                **kept,
                **{axis: columns[axis] for axis in "xyz"},
                "timestamp": clock.seconds(message, columns),
                "turn": np.full(len(columns["x"]), number, np.int32),
                "timed": np.full(len(columns["x"]), clock.column in columns),
            }


def _present(columns: Columns) -> Columns:
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise InputError(f"no field {', '.join(missing)}")
    rows = np.any([~np.isnan(columns[axis]) for axis in "xyz"], axis=0)
    return {name: values[rows] for name, values in columns.items()}


def _clock(message: CloudMessage, columns: Columns, unit: TimeUnit | None) -> _Clock:
    name = next((name for name in TIMES if name in columns), "")
    if not name:
        return _Clock(name, "s", message.stamp_ns, None)
    times = _signed(columns[name])
    inferred = unit or unit_of(times, np.arctan2(-columns["y"], columns["x"])) or _UNITS.get(name)
    if inferred is None:
        raise InputError(f"the unit of field {name} cannot be inferred: add --time-unit ns")
    origin = times.min().item() if is_since_1970(times, inferred) else None
    return _Clock(name, inferred, message.stamp_ns, origin)


def _signed(times: NDArray[Any]) -> NDArray[Any]:
    return times.astype(np.int64 if times.dtype.kind in "iu" else np.float64)

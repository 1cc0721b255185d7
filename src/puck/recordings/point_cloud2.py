"""Reader of the points' values in ROS messages of the type PointCloud2."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.isolated import Columns

POINT_CLOUD2 = "sensor_msgs/msg/PointCloud2"
KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""NumPy types by the codes of data types in the message."""
_PADDING = ("", "_")
"""Names of fields that contain no values."""
_MAX_VALUES = 4096
"""Maximum values of a point; PCL's largest descriptor has 1,980."""
_MAX_NAME_LENGTH = 40


class Value(NamedTuple):
    """Place of one value in the bytes of each point.

    It has a NumPy type, a byte offset in the point, and a position in a message field of several
    values.
    """

    name: str
    kind: np.dtype[Any]
    offset: int
    field: int
    part: int


def point_columns(message: Any, data: NDArray[np.uint8] | None = None) -> Columns:
    """Return the fields of a deserialised message as arrays by name, one value per point.

    Parameters
    ----------
    message
        A message of the type sensor_msgs/msg/PointCloud2.
    data
        The points' bytes, if they are not in the message.

    Returns
    -------
    dict of arrays (height * width,)
        A field `a` with several values per point becomes the columns `a_0`, `a_1`, ... The columns
        need at most the memory of the data.

    Raises
    ------
    InputError
        The message is inconsistent, or the data are too short.
    """
    data = np.asarray(message.data if data is None else data, dtype=np.uint8)
    height, width, step = int(message.height), int(message.width), int(message.point_step)
    row_step = int(message.row_step)
    _check_rows(height, width, step, row_step, len(data))
    columns: Columns = {}
    for name, kind, offset, *_ in point_values(message):
        columns[name] = np.zeros(0, kind.newbyteorder("="))
        if height * width:
            strides = (row_step if height > 1 else step * width, step)
            values: NDArray[Any] = np.ndarray((height, width), kind, data, offset, strides)
            columns[name] = values.astype(kind.newbyteorder("=")).reshape(-1)
    return columns


def point_values(message: Any) -> list[Value]:
    """Return the place of each value in the bytes of a point.

    Raises InputError if the message's fields are inconsistent.
    """
    order = ">" if message.is_bigendian else "<"
    values = list(_values(message.fields, order, int(message.point_step)))
    names = Counter(value.name for value in values)
    if repeated := [name for name, count in names.items() if count > 1]:
        raise InputError(f"PointCloud2: two fields are named {_shown(repeated[0])}")
    return values


def _check_rows(height: int, width: int, step: int, row_step: int, size: int) -> None:
    if not height * width:
        return
    points = f"{height} x {width} points of {step} bytes"
    if height > 1 and row_step < width * step:
        raise InputError(f"PointCloud2: rows of {row_step} bytes are too short for {points}")
    if step == 0 or (height - 1) * row_step * (height > 1) + width * step > size:
        raise InputError(f"PointCloud2: {size} bytes of data are not {points}")


def _values(fields: Any, order: str, step: int) -> Iterator[Value]:
    total = values = 0
    for place, field in enumerate(fields):
        if field.datatype not in KINDS:
            name = _shown(field.name)
            raise InputError(f"PointCloud2: field {name} has the unknown type {field.datatype}")
        kind = np.dtype(order + KINDS[field.datatype])
        count = max(int(field.count), 1)  # some drivers write 0
        offset, total, values = int(field.offset), total + count * kind.itemsize, values + count
        if total > step or offset + count * kind.itemsize > step:
            name = _shown(field.name)
            raise InputError(f"PointCloud2: field {name} does not fit in points of {step} bytes")
        if values > _MAX_VALUES:
            raise InputError(f"PointCloud2: points of more than {_MAX_VALUES} values")
        if field.name in _PADDING:
            continue
        for part in range(count):
            name = field.name if count == 1 else f"{field.name}_{part}"
            yield Value(name, kind, offset + part * kind.itemsize, place, part)


def _shown(name: str) -> str:
    return f"{name!r:.{_MAX_NAME_LENGTH}}"

"""Search for serialised messages of the type sensor_msgs/PointCloud2, by their content.

The list of a cloud's fields, as ROS 1 and CDR (ROS 2) serialise it, identifies a message. Before it
are the frame and the size of the cloud, and after it are the sizes of a point and of the data.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

from pointkit.errors import InputError
from puck.cloud_data import CloudField, CloudLayout
from puck.clouds.layout import SIZES

LARGEST_CLOUD = 3 << 24
"""Maximum number of bytes of a cloud's data. Larger clouds are not found."""
_FRAME_BYTES = 64
"""Number of bytes before a cloud's size in which the name of its frame is searched for."""
_BLOCK = 1 << 16
_FRAME = re.compile(rb"([!-~]*)\0*\Z")
_NAME = re.compile(rb"[ -~]{0,64}")
_MOST_FIELDS, _MOST_VALUES = 64, 4096
_SEARCHED_BYTES = 512
"""Number of bytes before the field x in which the list of fields may begin."""
_LONGEST_POINT, _LONGEST_HEADER = 1 << 16, 1 << 13


class _Encoding(NamedTuple):
    order: Literal["little", "big"]
    alignment: int
    ending: bytes  # of a text, which its length includes

    @property
    def x(self) -> bytes:
        """Length and name of the field x."""
        name = b"x" + self.ending
        return len(name).to_bytes(4, self.order) + name


_ENCODINGS = (
    _Encoding("little", 1, b""),
    _Encoding("little", 4, b"\0"),
    _Encoding("big", 4, b"\0"),
)


@dataclass(frozen=True)
class FoundCloud:
    """Place of a cloud's data in the bytes that were searched.

    Parameters
    ----------
    layout
        Fields of the points.
    frame
        Name of the coordinate frame, as bytes.
    width, height, row_step
        Size of the image that the points form, and bytes from one row to the next.
    head
        Position before which nothing of the message is needed to find it again.
    start, end
        Position of the first byte of the data, and of the first byte after them. The data may
        extend beyond the bytes that were searched.
    """

    layout: CloudLayout
    frame: bytes
    width: int
    height: int
    row_step: int
    head: int
    start: int
    end: int

    @property
    def points(self) -> int:
        """Number of points, or of steps of a point if there are bytes between rows."""
        return (self.end - self.start) // self.layout.point_step


class _CutError(Exception):
    """The bytes end within a message's header."""


class _Fields:
    """Reader of a serialised message from its list of fields on."""

    def __init__(self, data: bytes, place: int, encoding: _Encoding) -> None:
        self._data, self._encoding = data, encoding
        self._origin = self.at = place

    def take(self, size: int) -> bytes:
        first, self.at = self.at, self.at + size
        if self.at > len(self._data):
            raise _CutError
        return self._data[first : self.at]

    def byte(self) -> int:
        return self.take(1)[0]

    def word(self) -> int:
        self.at += (self._origin - self.at) % self._encoding.alignment
        return int.from_bytes(self.take(4), self._encoding.order)

    def text(self) -> bytes:
        ending = self._encoding.ending
        size = self.word()
        if not len(ending) <= size <= _FRAME_BYTES + len(ending):
            raise InputError("a text that is too long")
        text = self.take(size)
        if not text.endswith(ending) or not _NAME.fullmatch(text.removesuffix(ending)):
            raise InputError("a name of a field that is no text")
        return text.removesuffix(ending)

    def layout(self) -> CloudLayout:
        count = self.word()
        if not 1 <= count <= _MOST_FIELDS:
            raise InputError("no number of fields")
        fields = tuple(self._field() for _ in range(count))
        is_big_endian, point_step = self.byte(), self.word()
        ends = (each.offset + SIZES[each.datatype] * each.count for each in fields)
        if is_big_endian > 1 or not max(ends) <= point_step < _LONGEST_POINT:
            raise InputError("fields that are not in the points")
        return CloudLayout(fields, point_step, bool(is_big_endian))

    def _field(self) -> CloudField:
        name, offset, datatype, count = self.text(), self.word(), self.byte(), self.word()
        if datatype not in SIZES or offset > _LONGEST_POINT or count > _MOST_VALUES:
            raise InputError("no field")
        return CloudField(name.decode(), offset, datatype, count)


def find_clouds(data: bytes) -> Iterator[FoundCloud]:
    """Yield the clouds in `data`, in the order of their places.

    The last cloud may extend beyond the end of the data. It has no layout if its header does.
    """
    start = 0
    while start < len(data):
        end = start + _BLOCK  # so that the data of clouds are not searched
        places = ((data.find(each.x, start, end + len(each.x)), each) for each in _ENCODINGS)
        place, encoding = min((hit for hit in places if hit[0] >= 0), default=(-1, None))
        if encoding is None:
            start = end
            continue
        start = place + 1
        if cloud := _cloud_with_x(data, place, encoding):
            yield cloud
            start = cloud.end


def _cloud_with_x(data: bytes, place: int, encoding: _Encoding) -> FoundCloud | None:
    """Return the cloud whose description of the field x begins at `place`, or None without one.

    The list of fields begins there or, if x is not the first field, up to 512 bytes before.
    """
    first = max(place - _SEARCHED_BYTES, 8)
    for fields in range(place - 4, first - 1, -encoding.alignment):
        try:
            cloud = _cloud(data, fields, encoding)
        except InputError:
            continue
        except _CutError:
            layout, size = CloudLayout((), 1, False), len(data)
            end = size + _LONGEST_HEADER
            cloud = FoundCloud(layout, b"", 0, 0, 0, _head(fields), size, end)
        return cloud
    return None


def _head(fields: int) -> int:
    return max(fields - 8 - _FRAME_BYTES, 0)


def _cloud(data: bytes, fields: int, encoding: _Encoding) -> FoundCloud | None:
    reader = _Fields(data, fields, encoding)
    layout = reader.layout()
    row_step, size = reader.word(), reader.word()
    height, width = (
        int.from_bytes(data[at : at + 4], encoding.order) for at in (fields - 8, fields - 4)
    )
    step = layout.point_step
    if size != height * row_step or row_step < width * step:
        row_step = width * step
    if size != height * row_step:  # the message contradicts itself: all data are points
        width, height, row_step = size // step, 1, size // step * step
    size = height * row_step
    if not 0 < size <= LARGEST_CLOUD or not width:
        return None
    frame = _FRAME.search(data, _head(fields), fields - 8)
    return FoundCloud(
        layout,
        frame[1] if frame else b"",
        width,
        height,
        row_step,
        _head(fields),
        reader.at,
        reader.at + size,
    )

"""LAS files laid out by hand from the specification (ASPRS LAS 1.2 and 1.4), points of format 0."""

from __future__ import annotations

import struct
from collections.abc import Sequence

RECORD_BYTES = 20
CRS = "LASF_Projection"
GEO_KEYS, GEO_DOUBLES, WKT = 34735, 34736, 2112
Record = tuple[str, int, bytes]
"""User, number and content of a variable length record."""


def las_bytes(
    steps: Sequence[Sequence[int]],
    records: Sequence[Record] = (),
    *,
    minor: int = 2,
    scale: float = 0.01,
    offset: float = 0.0,
    count: int | None = None,
    record_count: int | None = None,
    extended: Sequence[Record] = (),
) -> bytes:
    """A file of points (n, 3) in steps of `scale` from `offset`; counts may be others than true."""
    length = 375 if minor >= 4 else 227
    before = b"".join(_record(record, "<H") for record in records)
    points = b"".join(struct.pack("<iiiHBBbBH", *step, 7, 9, 0, 0, 0, 0) for step in steps)
    begin, number = length + len(before), len(steps) if count is None else count
    head = struct.pack(
        "<4sHH16sBB32s32sHH", b"LASF", 0, 0, b"", 1, minor, b"OTHER", b"hand", 1, 2000
    )
    counts = len(records) if record_count is None else record_count
    head += struct.pack("<HIIBHI", length, begin, counts, 0, RECORD_BYTES, number % 2**32)
    head += bytes(20) + struct.pack("<6d", *[scale] * 3, *[offset] * 3) + bytes(48)
    if minor >= 4:
        after = begin + len(points) if extended else 0
        head += struct.pack("<QQIQ", 0, after, len(extended), number) + bytes(120)
    return head + before + points + b"".join(_record(record, "<Q") for record in extended)


def patched(data: bytes, at: int, layout: str, *values: float) -> bytes:
    """Return the content with other numbers from a byte on."""
    changed = bytearray(data)
    struct.pack_into(layout, changed, at, *values)
    return bytes(changed)


def with_bytes(data: bytes, at: int, more: bytes) -> bytes:
    """Return a file of LAS 1.0 to 1.2 with more bytes before its points, which begin at `at`."""
    return patched(data[:at] + more + data[at:], 96, "<I", at + len(more))


def with_extra_bytes(data: bytes, extra: Sequence[bytes]) -> bytes:
    """Return a file whose points (of `las_bytes`) each have these bytes more."""
    (begin,) = struct.unpack_from("<I", data, 96)
    starts = [begin + RECORD_BYTES * number for number in range(len(extra))]
    points = (data[at : at + RECORD_BYTES] + more for at, more in zip(starts, extra, strict=True))
    return patched(data[:begin] + b"".join(points), 105, "<H", RECORD_BYTES + len(extra[0]))


def extra_bytes(
    name: bytes, kind: int, options: int = 0, scale: float = 1.0, offset: float = 0.0
) -> Record:
    """A description of one extra dimension of a kind (1: uint8, 3: uint16, ...)."""
    head = struct.pack("<2xBB32s4x", kind, options, name)
    scaling = struct.pack("<d16xd16x", scale, offset)
    return "LASF_Spec", 4, head + bytes(72) + scaling + bytes(32)


def geo_keys(*keys: tuple[int, int] | tuple[int, int, int]) -> Record:
    """A GeoTIFF directory of keys and values, or of keys, places of doubles and their offsets."""
    entries = [key if len(key) == 3 else (key[0], 0, key[1]) for key in keys]
    parts = [struct.pack("<4H", number, place, 1, value) for number, place, value in entries]
    return CRS, GEO_KEYS, struct.pack("<4H", 1, 1, 0, len(entries)) + b"".join(parts)


def _record(record: Record, layout: str) -> bytes:
    user, number, content = record
    head = struct.pack("<H16sH", 0, user.encode(), number)
    return head + struct.pack(layout, len(content)) + bytes(32) + content

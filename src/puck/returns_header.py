"""Encoding of layouts of images and of sensors' beams as bytes in a stream's first records."""

from __future__ import annotations

import zlib
from dataclasses import astuple
from functools import cache

import numpy as np

from pointkit.coding.byte_io import Reader, base_128
from pointkit.errors import InputError
from pointkit.lidar.returns import Beams, Firing, Returns
from pointkit.lidar.sensors import load_sensor, sensor_names
from pointkit.lidar.turns import CENTIDEGREES, Layout

_QUANTUM_UNIT_M = 1e-7
_HAS_STEPS, _HAS_SHIFTS = 128, 64
"""Flags in the byte that states the kinds of return.

The layout ends with the number of azimuth steps minus 1, or with the lasers' shifts (16 bits each).
"""
_CLOCKWISE, _HAS_OFFSET = 1, 2
"""Flags: the sensor rotates clockwise; a range offset (8 bytes, m) follows."""
_MOST_NAME_BYTES = 255
_ROWS = (3, 5, 6, 9)
"""Possible numbers of values for each laser; the last values are omitted if unset."""
_DAMAGED = "the stream is damaged or truncated"
_USES: tuple[tuple[Firing, bool], ...] = (
    ("sequential", False),
    ("simultaneous", True),
    ("sequential", True),
)
"""Uses of a shipped sensor: real, virtual as in BlenSor, virtual with firing times."""


def encode_layout(layout: Layout) -> bytes:
    """Return a layout as bytes, in which up to 16 lasers take half a byte each."""
    kinds, more = layout.kinds, b""
    if layout.azimuth_steps != CENTIDEGREES:
        kinds |= _HAS_STEPS
        more = (layout.azimuth_steps - 1).to_bytes(2, "little")
    if layout.shifts:
        kinds |= _HAS_SHIFTS
        more += np.array(layout.shifts, "<i2").tobytes()
    sizes = [layout.columns_per_block, layout.blocks_per_time, kinds, layout.lasers]
    return bytes([*sizes, *_paired(layout.order)]) + more


def decode_layout(body: bytes) -> tuple[Layout, bytes]:
    """Decode the layout at the beginning of `body`, and return it with the bytes that follow."""
    reader = Reader(body)
    columns, blocks, kinds, lasers = reader.take(4)
    order, steps, shifts = _read_order(reader, lasers), CENTIDEGREES, b""
    if kinds & _HAS_STEPS:
        steps = int.from_bytes(reader.take(2), "little") + 1
    if kinds & _HAS_SHIFTS:
        shifts = reader.take(2 * lasers)
    kinds &= ~(_HAS_STEPS | _HAS_SHIFTS)
    columns_of_lasers = tuple(np.frombuffer(shifts, "<i2").tolist())
    try:
        return Layout(order, columns, blocks, kinds, steps, columns_of_lasers), reader.rest()
    except ValueError as error:
        raise InputError(f"the stream is damaged ({error})") from error


def _paired(order: tuple[int, ...]) -> tuple[int, ...]:
    # Up to 16 laser ids take half a byte each.
    if len(order) > 16:
        return order
    even = (*order, 0)[: -(-len(order) // 2) * 2]
    return tuple(even[k] | even[k + 1] << 4 for k in range(0, len(even), 2))


def _read_order(reader: Reader, lasers: int) -> tuple[int, ...]:
    if lasers > 16:
        return tuple(reader.take(lasers))
    pairs = reader.take(-(-lasers // 2))
    return tuple(part for pair in pairs for part in (pair & 15, pair >> 4))[:lasers]


@cache
def _shipped() -> dict[tuple[Beams, str], tuple[str, int]]:
    return {
        (_beams(name, use), load_sensor(name).name): (name, use)
        for name in sensor_names()
        for use in range(len(_USES))
    }


def _beams(name: str, use: int) -> Beams:
    firing, is_virtual = _USES[use]
    return Beams.of(load_sensor(name), firing, is_virtual)


def encode_beams(returns: Returns) -> bytes:
    """Return the range quantum, range offset and lasers of returns as bytes.

    The lasers are stored as the name of a sensor that this package knows, or as angles.
    """
    quantum = base_128(round(returns.quantum_m / _QUANTUM_UNIT_M))
    offset = np.array([returns.range_offset_m], "<f8").tobytes() if returns.range_offset_m else b""
    shipped = None if offset else _shipped().get((returns.beams, returns.sensor))
    angles = _angles(returns.beams)
    if shipped:
        name, use = shipped
        checksum = zlib.crc32(angles).to_bytes(4, "little")
        return quantum + bytes([use + 1, len(name)]) + name.encode() + checksum
    title = returns.sensor.encode()[:_MOST_NAME_BYTES]
    flags = returns.beams.clockwise * _CLOCKWISE | bool(offset) * _HAS_OFFSET
    return quantum + bytes([0, len(title)]) + title + bytes([flags]) + offset + angles


def _angles(beams: Beams) -> bytes:
    rows, none = astuple(beams), (0.0,) * beams.lasers
    rows = (*rows[:3], *rows[4:])  # without the direction of rotation
    count = next(each for each in _ROWS if not any(rows[each:]))
    return np.array([row or none for row in rows[:count]], "<f8").tobytes()


def decode_beams(body: bytes, layout: Layout) -> Returns:
    """Decode the bytes of `encode_beams`, and return a `Returns` object without turns.

    Raises InputError if the bytes are damaged, or name a sensor that is unknown or whose beams have
    changed since.
    """
    reader = Reader(body)
    quantum = reader.number() * _QUANTUM_UNIT_M
    use, length = reader.take(2)
    name = reader.take(length).decode("utf-8", "replace")
    if use:
        if use > len(_USES) or name not in sensor_names():
            raise InputError(f"the stream is damaged, or of a sensor that is not known ({name!r})")
        beams, sensor = _beams(name, use - 1), load_sensor(name).name
        if zlib.crc32(_angles(beams)).to_bytes(4, "little") != reader.rest():
            raise InputError(f"the stream was made with other laser angles of the sensor {name}")
        return Returns(beams, layout, (), quantum, sensor)
    flags = reader.take(1)[0]
    offset = float(np.frombuffer(reader.take(8), "<f8")[0]) if flags & _HAS_OFFSET else 0.0
    angle_bytes = reader.rest()
    if len(angle_bytes) not in [8 * rows * layout.lasers for rows in _ROWS]:
        raise InputError(_DAMAGED)
    angles = np.frombuffer(angle_bytes, "<f8").reshape(-1, layout.lasers)
    if not np.isfinite([*angles.flat, offset]).all() or not quantum > 0:
        raise InputError(_DAMAGED)
    elevations, heights, delays, *more = (tuple(row.tolist()) for row in angles)
    beams = Beams(elevations, heights, delays, bool(flags & _CLOCKWISE), *more)
    return Returns(beams, layout, (), quantum, name, offset)

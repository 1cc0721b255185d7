"""Kinds of an Ouster's packets, and conversion between packets and turns with further images.

A turn, i.e. one revolution, does not hold all data of packets. The rest is held in further images
and arrays, from which packets are restored bit for bit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled
from pointkit.errors import InputError
from pointkit.lidar.returns import HOUR_US
from pointkit.lidar.turns import Layout, Turn
from puck.recordings.ouster import (
    LEGACY,
    PROFILES,
    Field,
    OusterSensor,
    frame_numbers,
    packet_type,
    turn_of_columns,
)
from puck.recordings.packet_turns import Payloads, without_overlaps

_HALF_WORD = 16
_MOST_BYTES = 65535
_OUTSIDE_BYTES, _TIME_BYTES, _CRC_BYTES = 32, 8, 8
"""Numbers of bytes before (and after) a packet's columns, before a column's number, and of a
packet's CRC-64."""
_FRAGMENT_BYTES, _UDP_BYTES = 1480, 8
"""Numbers of bytes of an IP packet's payload (Ethernet frames of 1,500 bytes), and of its UDP
header."""
_NS = 1000
_HEAD = np.dtype([("hours", "<u4"), ("status", "<u4"), ("encoder", "<u4"), ("frame", "<u4")])
"""Header of a column; its time is the sum of hours, the turn's time in us and a remainder."""


class Channel(NamedTuple):
    """A pixel field, for one kind of return, that a `Turn` does not store but a further image does.

    For a reflectivity, `signal` is the index of the channel that holds the return's signal;
    otherwise it is None.
    """

    field: Field
    kind: int
    signal: int | None = None


class Rest(NamedTuple):
    """The data of a revolution's packets that a `Turn` does not store.

    Parameters
    ----------
    images
        An image (columns, lasers) for each channel (see `OusterKind.channels`).
    heads
        Headers of columns, (columns, bytes).
    outsides
        Data before and after each packet's columns, (packets, bytes). A correct CRC-64 becomes 0.
    remainders
        Remainders of times below 1 us, (columns,), in units of `unit` nanoseconds.
    """

    images: list[NDArray[np.uint16]]
    heads: Payloads
    outsides: Payloads
    remainders: NDArray[np.uint16]
    unit: int
    has_crc: bool


@dataclass(frozen=True)
class OusterKind:
    """Kind of an Ouster's packets: their format, and the layout of images of a turn.

    If `is_fragmented`, packets lie in the file as IP fragments of the usual size, `hole` bytes
    apart.
    """

    profile: str
    is_fusa: bool
    columns_per_packet: int
    layout: Layout
    is_fragmented: bool = False
    hole: int = 0

    @classmethod
    def of(cls, sensor: OusterSensor) -> OusterKind:
        """Return the kind of the packets that a sensor sends, none of which is fragmented."""
        return cls(sensor.profile, sensor.is_fusa, sensor.columns_per_packet, sensor.layout)

    @classmethod
    def decode(cls, layout: Layout, code: bytes) -> OusterKind:
        """Return the kind that `code` describes, together with a layout.

        Raises InputError if no packets have this code and layout.
        """
        profile, flags, columns = code
        if profile < len(PROFILES) and flags < 4 and columns > 1:
            is_fusa, is_fragmented = bool(flags & 1), bool(flags & 2)
            kind = cls(list(PROFILES)[profile], is_fusa, columns, layout, is_fragmented)
            sizes = (layout.columns_per_block, layout.blocks_per_time, layout.kinds)
            if kind.size <= _MOST_BYTES and sizes == (1, 1, len(PROFILES[kind.profile].ranges)):
                return kind
        raise InputError("the stream is damaged (a kind of packets)")

    @property
    def code(self) -> bytes:
        """Three bytes that describe the format of packets in a stream (see `decode`)."""
        flags = self.is_fusa | self.is_fragmented << 1
        return bytes([list(PROFILES).index(self.profile), flags, self.columns_per_packet])

    @property
    def pieces(self) -> list[int]:
        """Number of bytes of a packet in each IP fragment."""
        if not self.is_fragmented:
            return [self.size]
        edges = [0, *range(_FRAGMENT_BYTES - _UDP_BYTES, self.size, _FRAGMENT_BYTES), self.size]
        return [end - first for first, end in pairwise(edges)]

    @cached_property
    def packet(self) -> np.dtype[Any]:
        """NumPy structure of a packet."""
        return packet_type(self.profile, self.layout.lasers, self.columns_per_packet, self.is_fusa)

    @property
    def size(self) -> int:
        """Number of bytes of a packet."""
        return self.packet.itemsize

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """Pixel fields that no turn holds, which cover all bits that `turn_of` leaves out."""
        profile = PROFILES[self.profile]
        signals = [Channel(each, kind) for kind, each in enumerate(profile.signals)]
        dependent = [
            Channel(self._reflectivity(kind), kind, signal=kind) for kind in range(len(signals))
        ]
        used = [*profile.ranges, *profile.reflectivities]
        used += [channel.field for channel in (*signals, *dependent)]
        others = [Channel(each, 0) for each in _unused(used, profile.words)]
        return (*signals, *dependent, *others)

    def _reflectivity(self, kind: int) -> Field:
        bits = _HALF_WORD if self.profile == LEGACY else 8  # early firmware has 16 bits
        return PROFILES[self.profile].reflectivities[kind]._replace(bits=bits)

    def find(self, data: Payloads) -> NDArray[np.int64]:
        """Return the positions in `data` of packets with consecutive column numbers, ascending."""
        span = self.size + self.hole * (len(self.pieces) - 1)
        last = len(data) - span + 1
        if last < 1 or self.columns_per_packet < 2:
            return np.zeros(0, np.int64)
        size = self.packet["columns"].base.itemsize
        first = _TIME_BYTES + (0 if self.profile == LEGACY else _OUTSIDE_BYTES)
        numbers = first + size * np.arange(self.columns_per_packet)
        holes = np.repeat(self.hole * np.arange(len(self.pieces)), self.pieces)
        low, high = numbers + holes[numbers], numbers + 1 + holes[numbers + 1]
        first_at, second_at = (data[at : at + last] for at in low[:2].tolist())
        places = np.flatnonzero(second_at - first_at == 1)
        for earlier, at in pairwise(low[1:].tolist()):
            places = places[data[places + at] - data[places + earlier] == 1]
        columns = data[places[:, None] + low].astype(np.int64)
        columns += 256 * data[places[:, None] + high].astype(np.int64)
        is_packet = (np.diff(columns) == 1).all(axis=1)
        is_packet &= columns[:, -1] < self.layout.azimuth_steps
        return without_overlaps(places[is_packet], span)

    def split_turns(self, payloads: Payloads) -> Iterator[tuple[OusterKind, Payloads]]:
        """Split packets (p, size) into revolutions where the counter of revolutions changes.

        Yields this kind and the packets of each revolution.
        """
        changes = np.flatnonzero(np.diff(frame_numbers(self._viewed(payloads)))) + 1
        most = self.layout.max_blocks // self.columns_per_packet
        for first, end in pairwise([0, *changes.tolist(), len(payloads)]):
            for start in range(first, end, most):
                yield self, payloads[start : min(start + most, end)]

    def turn_of(self, payloads: Payloads) -> Turn:
        """Convert the packets (p, size) of a revolution to a turn."""
        profile = PROFILES[self.profile]
        turn = turn_of_columns(profile, self._columns(payloads), self.layout.azimuth_steps)
        return replace(turn, reflectivities=None) if profile.signals else turn

    def rest_of(self, payloads: Payloads) -> Rest:
        """Return the data of the packets (p, size) of a revolution that the turn does not hold."""
        columns = self._columns(payloads)
        words = columns["pixels"]
        images = [channel.field.of(words).astype(np.uint16) for channel in self.channels]
        heads = np.zeros(len(columns), _HEAD)
        heads["hours"] = columns["time"] // np.uint64(_NS * HOUR_US)
        for name in ("status", "encoder", "frame"):
            if name in (columns.dtype.names or ()):
                heads[name] = columns[name]
        remainders = (columns["time"] % np.uint64(_NS)).astype(np.uint16)
        unit = max(int(np.gcd.reduce(remainders)), 1)
        outsides, has_crc = self._outsides(payloads)
        return Rest(
            images, heads.view(np.uint8).reshape(len(heads), -1), outsides,
            remainders // np.uint16(unit), unit, has_crc,
        )  # fmt: skip

    def packets_of(self, turn: Turn, rest: Rest) -> Payloads:
        """Restore the packets (p, size) of a revolution bit for bit from the turn and the rest."""
        count, uneven = divmod(len(turn.azimuths), self.columns_per_packet)
        if uneven or turn.times is None or rest.remainders.max(initial=0) * rest.unit >= _NS:
            raise InputError("the stream is damaged (packets of a turn)")
        packets = np.zeros(count, self.packet)
        columns = np.zeros(len(turn.azimuths), self.packet["columns"].base)
        steps = self.layout.azimuth_steps
        columns["column"] = (turn.azimuths.astype(np.int64) - steps // 2) % steps
        heads = np.ascontiguousarray(rest.heads).view(_HEAD)[:, 0]
        microseconds = heads["hours"].astype(np.uint64) * np.uint64(HOUR_US) + turn.times
        columns["time"] = microseconds * np.uint64(_NS) + rest.remainders * np.uint64(rest.unit)
        for name in ("status", "encoder", "frame"):
            if name in (columns.dtype.names or ()):
                columns[name] = heads[name]
        profile, words = PROFILES[self.profile], columns["pixels"]
        fields = [*zip(profile.ranges, turn.ranges, strict=True)]
        if turn.reflectivities is not None:
            fields += zip(profile.reflectivities, turn.reflectivities, strict=True)
        others = [channel.field for channel in self.channels]
        fields += zip(others, rest.images, strict=True)
        for field, values in fields:
            mask = np.uint32((1 << field.bits) - 1)
            words[..., field.word] |= (values.astype(np.uint32) & mask) << np.uint32(field.bit)
        packets["columns"] = columns.reshape(count, -1)
        payloads = packets.view(np.uint8).reshape(count, -1)
        if self.profile != LEGACY:
            payloads[:, :_OUTSIDE_BYTES] = rest.outsides[:, :_OUTSIDE_BYTES]
            payloads[:, -_OUTSIDE_BYTES:] = rest.outsides[:, _OUTSIDE_BYTES:]
        if rest.has_crc:
            payloads[:, -_CRC_BYTES:] = checks_of(payloads)
        return payloads

    @property
    def outside_bytes(self) -> int:
        """Number of bytes of a packet that lie before and after the columns."""
        return 0 if self.profile == LEGACY else 2 * _OUTSIDE_BYTES

    def _outsides(self, payloads: Payloads) -> tuple[Payloads, bool]:
        if self.profile == LEGACY:
            return np.zeros((len(payloads), 0), np.uint8), False
        edges = [payloads[:, :_OUTSIDE_BYTES], payloads[:, -_OUTSIDE_BYTES:]]
        outsides = np.concatenate(edges, axis=1)
        has_crc = bool((outsides[:, -_CRC_BYTES:] == checks_of(payloads)).all())
        if has_crc:
            outsides[:, -_CRC_BYTES:] = 0
        return outsides, has_crc

    def _viewed(self, payloads: Payloads) -> NDArray[Any]:
        return np.ascontiguousarray(payloads).view(self.packet)[:, 0]

    def _columns(self, payloads: Payloads) -> NDArray[Any]:
        columns: NDArray[Any] = self._viewed(payloads)["columns"].reshape(-1)
        return columns


HEAD_BYTES = _HEAD.itemsize


def _unused(fields: list[Field], words: int) -> list[Field]:
    """Return fields of at most 16 bits that cover the unused bits of a pixel."""
    is_used = np.zeros(32 * words, bool)
    for field in fields:
        first = 32 * field.word + field.bit
        is_used[first : first + field.bits] = True
    unused = []
    for start in range(0, 32 * words, _HALF_WORD):
        half = is_used[start : start + _HALF_WORD]
        edges = [0, *(np.flatnonzero(np.diff(half)) + 1).tolist(), _HALF_WORD]
        unused += [
            Field((start + first) // 32, (start + first) % 32, end - first)
            for first, end in pairwise(edges)
            if not half[first]
        ]
    return unused


def checks_of(payloads: Payloads) -> Payloads:
    """Return the CRC-64 (ECMA-182, reflected) of each packet without its last 8 bytes, (p, 8)."""
    checks = np.zeros(len(payloads), np.uint64)
    _write_checks(np.ascontiguousarray(payloads), _crc_tables(), checks)
    return checks.astype("<u8").view(np.uint8).reshape(-1, _CRC_BYTES)


@cache
def _crc_tables() -> NDArray[np.uint64]:
    """Return the CRCs (8, 256) of each byte when 0 to 7 zero bytes follow."""
    tables = np.zeros((8, 256), np.uint64)
    tables[0] = np.arange(256)
    for _ in range(8):
        tables[0] = (tables[0] >> 1) ^ np.uint64(0xC96C5795D7870F42) * (tables[0] & 1)
    for k in range(1, 8):
        tables[k] = tables[0, tables[k - 1] & 255] ^ (tables[k - 1] >> 8)
    return tables


@compiled
def _write_checks(
    payloads: Payloads, tables: NDArray[np.uint64], checks: NDArray[np.uint64]
) -> None:
    end = payloads.shape[1] - _CRC_BYTES
    whole = end // 8 * 8
    for row in range(len(payloads)):
        check = np.uint64(0xFFFFFFFFFFFFFFFF)
        for at in range(0, whole, 8):
            folded = np.uint64(0)
            for k in range(8):  # eight bytes at a time, since a step waits for the one before
                byte = (check >> np.uint64(8 * k)) & np.uint64(255) ^ payloads[row, at + k]
                folded ^= tables[7 - k, byte]
            check = folded
        for byte in payloads[row, whole:end]:
            check = tables[0, (np.uint64(byte) ^ check) & np.uint64(255)] ^ (check >> np.uint64(8))
        checks[row] = check ^ np.uint64(0xFFFFFFFFFFFFFFFF)

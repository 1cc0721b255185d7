"""Writing and reading of streams turn by turn, and decoding of some turns of a stream."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from types import TracebackType
from typing import IO, NamedTuple, Self

import numpy as np

from pointkit.errors import InputError
from pointkit.lidar.turns import Layout, Turn
from puck.fields import FieldsDecoder
from puck.options import CodingOptions
from puck.packet_kinds import count_values
from puck.recordings.ouster import PROFILES
from puck.recordings.ouster_packets import OusterKind
from puck.records import (
    DAMAGED,
    Record,
    RecordKind,
    RecordPlace,
    check,
    check_ranges,
    count_ranges,
    places_of_records,
    read_record,
    read_records,
    start,
)
from puck.returns_header import decode_layout, encode_layout
from puck.sensors import sensor_number
from puck.turns import TurnDecoder, TurnEncoder, is_key

_OUSTER_CODE_BYTES = 3


class Writer:
    """Encoder that writes turns to a binary file as they come.

    The stream equals that of `encode_turns`. Use the writer in a ``with`` block, or call `close`
    after the last turn; otherwise, the stream counts as truncated. The file stays open.

    Parameters
    ----------
    stream
        Binary file, pipe or socket (as a file) to write to.
    layout
        Arrangement of the lasers in the images of all turns.
    options
        Options of encoding. By default, nothing is lost.
    """

    def __init__(
        self, stream: IO[bytes], layout: Layout, options: CodingOptions | None = None
    ) -> None:
        self._stream, self._encoder = stream, TurnEncoder(layout, options)
        self._is_open = True
        stream.write(start())
        self._write(Record(RecordKind.LAYOUT, encode_layout(layout)))

    def add(self, turn: Turn) -> int:
        """Encode the next turn and write it, so that a reader can decode it at once.

        Returns
        -------
        int
            Number of bytes written.

        Raises
        ------
        InputError
            The arrays of the turn do not have the layout's shapes and types.
        ValueError
            The writer is closed.
        """
        if not self._is_open:
            raise ValueError("the writer is closed")
        return self._write(Record(RecordKind.TURN, self._encoder.encode(turn)))

    def close(self) -> None:
        """Write the end of the stream, unless it is written already."""
        if self._is_open:
            self._write(Record(RecordKind.END, b""))
            self._is_open = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is None:
            self.close()

    def _write(self, record: Record) -> int:
        packed = record.packed()
        self._stream.write(packed)
        self._stream.flush()
        return len(packed)


def read_turns(stream: IO[bytes]) -> Iterator[Turn]:
    """Decode the turns of a stream one after another, while its bytes come.

    Each turn is yielded as soon as its last byte is read; only one is in memory.

    Parameters
    ----------
    stream
        Binary file, pipe or socket (as a file) with a stream that `Writer`, `encode_turns`,
        `encode_returns` or `compress` wrote.

    Yields
    ------
    Turn
        The turns in chronological order, as those of `decode_turns`. Their number is not limited,
        since the caller can stop.

    Raises
    ------
    InputError
        The stream is damaged or truncated, or of another version.
    """
    decoders = {0: (decoder := _Decoder())}
    for record in read_records(stream):
        if record.kind == RecordKind.SENSOR:
            decoder = decoders.setdefault(sensor_number(record.body), _Decoder())
        turn = decoder.decode(record)
        if turn is not None:
            yield turn


def decode_turns(stream: bytes | IO[bytes], first: int = 0, end: int | None = None) -> list[Turn]:
    """Decode some turns of a stream or of a compressed recording.

    Parameters
    ----------
    stream
        The bytes of a whole stream that `Writer`, `encode_turns`, `encode_returns` or `compress`
        wrote; or a binary file with the stream, of which only the parts that are needed are read.
    first, end
        The turns from `first` to `end` - 1, counted from 0, are decoded. If `end` is None, all
        turns from `first` on are decoded. Most turns need the turn before them; decoding therefore
        starts at the last key turn up to `first`.

    Returns
    -------
    list of Turn
        The turns in chronological order; those of several sensors alternate in groups. They lack an
        Ouster's signals and ambient light, which only `decompress` restores.

    Raises
    ------
    InputError
        The stream is damaged, or has more ranges than a stream of its size may hold.
    """
    file = BytesIO(stream) if isinstance(stream, bytes | bytearray | memoryview) else stream
    parts = list(_parts_of_turns(file, end))
    keys = _key_turns(parts, first)
    needed = [
        part
        for part in parts
        if part.sensor in keys
        and (part.turn >= keys[part.sensor] or part.place.kind == RecordKind.LAYOUT)
    ]
    _check_ranges(file, needed)
    decoders, turns, decoded = dict[int, _Decoder](), list[Turn](), 0
    for part in needed:
        decoder = decoders.setdefault(part.sensor, _Decoder())
        turn = decoder.decode(read_record(file, part.place.at))
        if turn is not None:
            decoded += 1
            turns += [turn] if part.turn >= first else []
    check(decoded == sum(part.place.kind == RecordKind.TURN for part in needed))
    return turns


class _Part(NamedTuple):
    """Record of a turn or of a layout, with its sensor's number and the number of the turn.

    A layout has the number of the next turn.
    """

    sensor: int
    turn: int
    place: RecordPlace


def _parts_of_turns(file: IO[bytes], end: int | None) -> Iterator[_Part]:
    sensor, turn = 0, -1
    for place in places_of_records(file):
        turn += place.kind == RecordKind.TURN
        if end is not None and turn >= end:
            return
        if place.kind == RecordKind.SENSOR:
            sensor = sensor_number(place.start)
        elif place.kind == RecordKind.LAYOUT:
            yield _Part(sensor, turn + 1, place)
        elif place.kind in (RecordKind.TURN, RecordKind.FIELDS):
            yield _Part(sensor, turn, place)


def _key_turns(parts: list[_Part], first: int) -> dict[int, int]:
    """Return at which turn decoding of each sensor's turns from `first` on begins."""
    last_keys, keys = dict[int, int](), dict[int, int]()
    for sensor, turn, place in parts:
        if place.kind == RecordKind.TURN and sensor not in keys:
            if is_key(place.start):
                last_keys[sensor] = turn
            if turn >= first:
                keys[sensor] = last_keys.get(sensor, 0)
    return keys


def _check_ranges(file: IO[bytes], parts: list[_Part]) -> None:
    ranges, forms = 0, dict[int, _Format]()
    for sensor, _, place in parts:
        if place.kind == RecordKind.LAYOUT:
            forms[sensor] = _Format.of(read_record(file, place.at))
        elif place.kind == RecordKind.TURN:
            if sensor not in forms:
                raise InputError(DAMAGED)
            ranges += forms[sensor].count_ranges(place.start)
    check_ranges(ranges, file.seek(0, os.SEEK_END))


class _Format(NamedTuple):
    layout: Layout
    kind: OusterKind | None  # if reflectivities are coded with the fields

    @classmethod
    def of(cls, record: Record) -> _Format:
        layout, code = decode_layout(record.body)
        kind = OusterKind.decode(layout, code) if len(code) == _OUSTER_CODE_BYTES else None
        return cls(layout, kind if kind and PROFILES[kind.profile].signals else None)

    def count_ranges(self, body: bytes) -> int:
        """Return the number of ranges and of field values of a coded turn, given its beginning."""
        return count_values(self.kind, body) if self.kind else count_ranges(self.layout, body)


class _Decoder:
    """Decoder of records, which must be given in the order of the stream."""

    def __init__(self) -> None:
        self._turns: TurnDecoder | None = None
        self._kind: OusterKind | None = None
        self._waiting: tuple[Turn, bool] | None = None  # for its fields; whether it is a key turn

    def decode(self, record: Record) -> Turn | None:
        """Return the turn that a record completes, or None if it completes none."""
        if record.kind == RecordKind.FIELDS:
            return self._with_reflectivities(record.body) if self._kind else None
        check(self._waiting is None)
        if record.kind == RecordKind.LAYOUT:
            layout, self._kind = _Format.of(record)
            self._turns = TurnDecoder(layout)
            self._fields = FieldsDecoder(self._kind) if self._kind else None
        elif record.kind == RecordKind.TURN:
            if self._turns is None:
                raise InputError(DAMAGED)
            turn = self._turns.decode(record.body)
            if not self._kind:
                return turn
            self._waiting = (turn, is_key(record.body))
        return None

    def _with_reflectivities(self, body: bytes) -> Turn:
        kind, fields = self._kind, self._fields
        if kind is None or fields is None or self._waiting is None:
            raise InputError(DAMAGED)
        (turn, is_key_turn), self._waiting = self._waiting, None
        rest = fields.decode(body, turn, is_key=is_key_turn)
        images = [
            image
            for image, channel in zip(rest.images, kind.channels, strict=True)
            if channel.signal is not None
        ]
        return replace(turn, reflectivities=np.stack(images).astype(np.uint8))

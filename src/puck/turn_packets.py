"""Packets of some turns of a packet capture, read or restored without the rest of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise, zip_longest
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from pointkit.coding.byte_io import Reader
from pointkit.files import open_file
from puck.gaps import decode_gaps, decompress_bytes
from puck.metadata import read_metadata
from puck.packet_kinds import (
    Kind,
    PacketFormat,
    PacketsDecoder,
    decode_kind,
    formats_of,
)
from puck.recording import FoundPackets, search
from puck.recordings.captured_packets import START_BYTES, is_packet_capture
from puck.recordings.packet_turns import Payloads
from puck.records import RecordKind, RecordPlace, is_stream, places_of_records, read_record
from puck.sensors import PacketSorter
from puck.turns import is_key
from puck.windows import windows_of

_MOST_BYTES = 1 << 25
"""Maximum number of bytes of a turn's packets."""
_MOST_START, _FIRST_GAPS = 1 << 18, 8
"""Maximum number of bytes at the start of a capture that are read for its first packets, and number
of gaps between these packets."""
_MOST_OFF = 0.1
"""Largest deviation of a turn's length from the median, as a share of it."""


@dataclass(frozen=True)
class TurnIndex(ABC):
    """Places of the turns of one sensor in a packet capture.

    Attributes
    ----------
    path
        The capture, which may be compressed.
    kind
        Kind of its packets.
    metadata
        Content of the JSON file of an Ouster sensor, in the capture or beside it; else empty.
    """

    path: Path
    kind: Kind
    metadata: bytes

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of turns."""

    @abstractmethod
    def packets(self, first: int, end: int) -> list[Payloads]:
        """Read the packets (p, bytes) of each turn from `first` to `end` - 1, counted from 0.

        Turns beyond the recording are left out. InputError is raised if the file is damaged.
        """

    @abstractmethod
    def start(self) -> bytes:
        """Return the first bytes of the capture, with the first packets and their headers.

        The result is empty if other content of the capture comes before the packets.
        """


def index_turns(path: Path) -> TurnIndex | None:
    """Find the turns of a packet capture.

    In a file that `puck.compress` wrote, a turn is found by its record, and decoding begins at the
    key turn before it. Any other file is searched for packets, window by window.

    Returns
    -------
    TurnIndex or None
        The turns. None if they may be no revolutions of one sensor: there are several sensors or
        kinds of packets, or none; packets are late; turns differ in length; or the file is no
        packet capture, as packets in bags may be in parts.

    Raises
    ------
    InputError
        The file cannot be read or is damaged.
    """
    return _index_of_stream(path) if is_stream(path) else _index_of_recording(path)


class _Span(NamedTuple):
    """Positions in a file of a turn's first byte, and of the byte after its last."""

    start: int
    end: int


@dataclass(frozen=True)
class _RecordingIndex(TurnIndex):
    format: PacketFormat
    spans: Sequence[_Span]

    @property
    def count(self) -> int:
        return len(self.spans)

    def start(self) -> bytes:
        with open_file(self.path) as file:
            return file.read(_MOST_START) if self.spans[0].start < _MOST_START // 2 else b""

    def packets(self, first: int, end: int) -> list[Payloads]:
        turns = []
        with open_file(self.path) as file:
            for start, stop in self.spans[first:end]:
                file.seek(start)
                content = np.frombuffer(file.read(stop - start), np.uint8)
                turns.append(FoundPackets(self.format, self.format.find(content)).payloads(content))
        return turns


def _index_of_recording(path: Path) -> TurnIndex | None:
    found: set[tuple[Any, ...]] = set()  # kind, number of the format, number of the sensor
    lengths, spans, done, sorter = list[int](), list[_Span](), 0, PacketSorter()
    with windows_of(path) as windows:
        if not is_packet_capture(windows.next(START_BYTES)[0].tobytes()):
            return None
        metadata = read_metadata(path)
        formats = formats_of(metadata.sensors)
        for content, all_packets, _ in search(windows, formats):
            if not all_packets:
                done += len(content)
                continue
            packets, *others = all_packets
            form, places = packets
            by_sensor, order, _ = sorter.sort(content, [packets.located(content)])
            turns = [*packets.turns(content)]
            found |= {(kind, formats.index(form), *by_sensor) for kind, _ in turns}
            if others or order or len(found) > 1:
                return None
            counts = [len(payloads) for _, payloads in turns]
            lengths += counts
            for first, end in pairwise(accumulate(counts, initial=0)):
                start, last = places[[first, end - 1]].tolist()
                spans.append(_Span(done + start, done + last + form.span))
            done += len(content)
        if not found or not _are_alike(lengths):
            return None
        ((kind, number, _),) = found
        return _RecordingIndex(path, kind, metadata.content, formats[number], spans)


@dataclass(frozen=True)
class _StreamIndex(TurnIndex):
    layout: bytes
    places: Sequence[RecordPlace]
    starts: Sequence[int]
    """Index of each turn's record in `places`."""
    gaps: Sequence[bytes]
    """Bytes before and between the first packets, if these are in one piece."""

    @property
    def count(self) -> int:
        return len(self.starts)

    def start(self) -> bytes:
        packets = (packet.tobytes() for turn in self.packets(0, 1) for packet in turn)
        return b"".join(part for both in zip(self.gaps, packets, strict=False) for part in both)

    def packets(self, first: int, end: int) -> list[Payloads]:
        end = min(end, self.count)
        if first >= end:
            return []
        keys = (k for k in range(first + 1) if is_key(self.places[self.starts[k]].start))
        key = max(keys, default=0)
        stop = self.starts[end] if end < self.count else len(self.places)
        decoder = PacketsDecoder(_MOST_BYTES)
        decoder.start_layout(self.layout)
        turns: list[Payloads] = []
        with open_file(self.path) as file:
            needed = self.places[self.starts[key] : stop]
            for place, following in zip_longest(needed, needed[1:]):
                if place.kind == RecordKind.TURN:
                    decoder.add_turn(read_record(file, place.at).body)
                elif place.kind == RecordKind.FIELDS:
                    decoder.add_fields(read_record(file, place.at).body)
                else:
                    continue
                if following is None or following.kind != RecordKind.FIELDS:
                    count, pieces = decoder.take()
                    turns.append(np.frombuffer(b"".join(pieces), np.uint8).reshape(count, -1))
        return turns[first - key :]


def _index_of_stream(path: Path) -> TurnIndex | None:
    with open_file(path) as file:
        places = list(places_of_records(file))
        layouts = [place for place in places if place.kind == RecordKind.LAYOUT]
        starts = [k for k, place in enumerate(places) if place.kind == RecordKind.TURN]
        if len(layouts) != 1 or not _are_alike([_count_blocks(places[k].start) for k in starts]):
            return None
        gaps = _first_gaps(file, places)
        if not is_packet_capture(gaps[0][:START_BYTES]):
            return None
        layout = read_record(file, layouts[0].at).body
        metadata = _metadata(file, places) or read_metadata(path).content
        gaps = gaps if _is_first(places, RecordKind.TURN, RecordKind.GAPS) else gaps[:0]
        return _StreamIndex(path, decode_kind(layout), metadata, layout, places, starts, gaps)


def _metadata(file: IO[bytes], places: list[RecordPlace]) -> bytes:
    place = next((place for place in places if place.kind == RecordKind.METADATA), None)
    if place is None:
        return b""
    return decompress_bytes(Reader(read_record(file, place.at).body), lambda size: None)


def _first_gaps(file: IO[bytes], places: list[RecordPlace]) -> list[bytes]:
    """Return the first bytes of a compressed file that are in no packet, before and between them.

    The first is empty if the file has no such bytes, or has pages of SQLite.
    """
    gaps = next((place for place in places if place.kind == RecordKind.GAPS), None)
    if gaps is None or any(place.kind == RecordKind.PAGES for place in places):
        return [b""]
    reader = Reader(read_record(file, gaps.at).body)
    pieces = reader.number()
    return decode_gaps(reader, pieces + 1, lambda size: None)[:_FIRST_GAPS]


def _is_first(places: list[RecordPlace], kind: RecordKind, other: RecordKind) -> bool:
    """Return whether the first record of a kind precedes the first one of another kind."""
    kinds = [place.kind for place in places]
    return kind in kinds and other in kinds and kinds.index(kind) < kinds.index(other)


def _are_alike(lengths: list[int]) -> bool:
    """Return whether all turns but the first and the last, which may be cut off, are as long."""
    whole = np.array(lengths[1:-1])
    if not len(whole):
        return True
    usual = np.median(whole)
    return bool((np.abs(whole - usual) <= _MOST_OFF * usual).all())


def _count_blocks(body: bytes) -> int:
    reader = Reader(body)
    reader.take(1), reader.number()
    return reader.number()

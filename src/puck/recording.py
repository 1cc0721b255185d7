"""Lossless compression of recordings, or of any other file.

Data packets are found by their content; the packets of a revolution are encoded as one turn.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, zip_longest
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader, base_128
from pointkit.errors import InputError, naming
from pointkit.files import open_file, refuse_special, unreadable, written_whole
from puck.gaps import Bytes, compress_bytes, decode_gaps, decompress_bytes, encode_gaps, store_gaps
from puck.options import CodingOptions
from puck.packet_kinds import (
    VELODYNE,
    Kind,
    PacketFormat,
    PacketsDecoder,
    PacketsEncoder,
    count_values,
    decode_kind,
    described_sensors,
    formats_of,
)
from puck.recordings.ouster import sensor_of, write_metadata_beside
from puck.recordings.packet_turns import Payloads
from puck.records import DAMAGED, Record, RecordKind, check, most_ranges, read_records, start
from puck.sqlite_pages import (
    LARGEST_PAGE,
    LINK_BYTES,
    SMALLEST_PAGE,
    decode_links,
    encode_links,
    page_size,
    without_links,
)

_WINDOW = 1 << 24
"""Number of bytes that are searched for packets at a time. Their turns form a batch."""
_MANY_BYTES, _BYTES_PER_BYTE = 3 << 24, 40
"""Limit of a restored recording's size: a constant, and more for each byte of the stream."""
_FRAME_BYTES = 16
"""Maximum number of bytes that state the length of a gap. A decoder counts them as output, too."""

Content = bytes
Report = Callable[[int, int], None]
"""Function that is called with the number of processed bytes and the number of all bytes."""


@dataclass(kw_only=True)
class _Counts:
    packets: int = 0
    turns: int = 0
    returns: int = 0
    ranges: int = 0

    def add(self, other: _Counts) -> None:
        self.packets += other.packets
        self.turns += other.turns
        self.returns += other.returns
        self.ranges += other.ranges


@dataclass(kw_only=True)
class RecordingSummary(_Counts):
    """Counts of what a recording holds, and its sizes before and after compression.

    Parameters
    ----------
    packets, turns, returns
        Number of data packets, number of turns (revolutions) that they form, and number of returns
        in these turns.
    ranges
        Number of pixels of range images, with and without a return, plus pixels of other images.
        Decoders limit this number.
    bytes, compressed
        Size of the recording and size of its stream, in bytes.
    parts
        Number of bytes of the stream by kind of record.
    metadata
        Content of the JSON file that describes an Ouster sensor, if it is in the stream.
    """

    bytes: int = 0
    compressed: int = 0
    parts: dict[str, int] = field(default_factory=dict)
    metadata: Content = b""

    def as_json(self) -> dict[str, Any]:
        """Return sizes, compressed share (``share``) and counts by name, as the commands print."""
        share = self.compressed / self.bytes if self.bytes else 1.0
        return {
            "bytes": self.bytes,
            "compressed_bytes": self.compressed,
            "share": round(share, 4),
            "packets": self.packets,
            "turns": self.turns,
            "returns": self.returns,
        }


@dataclass(frozen=True)
class _Limits:
    size: int
    trusted: bool = False

    @property
    def bytes(self) -> int:
        return _MANY_BYTES + _BYTES_PER_BYTE * self.size

    @property
    def ranges(self) -> int:
        return most_ranges(self.size)

    def check(self, number: int, most: int, what: str) -> None:
        if number > most and not self.trusted:
            raise InputError(
                f"{number} {what} in {self.size} bytes: more than they can hold; if you trust the "
                "file, restore it with decompress --trusted"
            )


@dataclass(kw_only=True)
class _Batch(_Counts):
    records: list[Record] = field(default_factory=list)


def compress(
    recording: Path, out: Path, options: CodingOptions | None = None, report: Report | None = None
) -> RecordingSummary:
    """Compress any file so that `decompress` restores it bit for bit.

    The function finds data packets of known sensors by their content, and codes the packets of a
    revolution as one turn. LZMA compresses all other bytes. Packets of an Ouster are found only if
    the sensor's metadata are in the recording, which is a bag, or in a JSON file beside it. The
    stream then contains this file.

    Parameters
    ----------
    recording
        Packet capture, ROS bag, or any other file.
    out
        File to write. If compression fails, no incomplete file is left.
    options
        Options of encoding. Only `effort` and `key_every` may differ from their defaults, since
        nothing may be lost.
    report
        Function that is called with the number of processed bytes and the number of all bytes, to
        show progress.

    Returns
    -------
    RecordingSummary
        Number of packets, turns and returns, and the sizes of both files in bytes.

    Raises
    ------
    InputError
        The recording cannot be read, `out` cannot be written or is the recording itself, or
        `options` are lossy.
    """
    options = options or CodingOptions()
    if options.step != 1 or not options.times or not options.reflectivities:
        raise InputError("a recording is compressed without loss and with all that is in it")
    _check_different(recording, out)
    data = _mapped(recording)
    summary = RecordingSummary(bytes=len(data))
    with written_whole(out) as temporary, temporary.open("wb") as stream:
        summary.compressed = stream.write(start())
        sensors, metadata = described_sensors(recording)
        formats = formats_of(sensors)
        for record in _records(
            data, formats, metadata, options, summary, report or (lambda done, size: None)
        ):
            size = stream.write(record.packed())
            name = record.kind.name.lower()
            summary.parts[name] = summary.parts.get(name, 0) + size
            summary.compressed += size
    return summary


def decompress(
    path: Path, out: Path, report: Report | None = None, *, trusted: bool = False
) -> RecordingSummary:
    """Restore a file that `compress` compressed, and verify its checksum.

    If the stream contains an Ouster's metadata, they are written beside the file with the suffix
    ``.json``, unless metadata lie there already. A warning tells if these are others.

    Parameters
    ----------
    path
        File that `compress` wrote (.puck).
    out
        File to write. If decompression fails, no incomplete file is left.
    report
        Function that is called with the number of processed bytes and the number of all bytes of
        the stream, to show progress.
    trusted
        Whether to restore a file of any size. By default, the function refuses to write more than
        48 MiB plus 40 bytes for each byte of the stream, because a small stream can be made to fill
        the disk.

    Returns
    -------
    RecordingSummary
        Number of packets, turns and returns, and the sizes of both files in bytes.

    Raises
    ------
    InputError
        The stream is damaged, or of another format or version; the restored file would be too
        large; or a file cannot be read or written.
    """
    _check_different(path, out)
    source = open_file(path)
    size = path.stat().st_size
    limits, report = _Limits(size, trusted), report or (lambda done, size: None)
    with source, written_whole(out) as temporary, temporary.open("wb") as stream, naming(path):
        summary = _restore(source, stream, limits, report)
    if summary.metadata:
        write_metadata_beside(out, summary.metadata)
    return summary


def _check_different(source: Path, out: Path) -> None:
    if source.exists() and out.exists() and source.samefile(out):
        raise InputError(f"{out}: is the file that is read; name another one to write")


def _mapped(path: Path) -> Bytes:
    refuse_special(path)
    try:
        if path.stat().st_size == 0:
            return np.zeros(0, np.uint8)
        data: Bytes = np.asarray(np.memmap(path, np.uint8, "r"))
    except (OSError, ValueError) as error:
        if path.is_dir():
            raise InputError(f"{path}: a folder; compress the files in it") from error
        raise unreadable(path, error if isinstance(error, OSError) else OSError()) from error
    return data


def _records(
    data: Bytes,
    formats: list[PacketFormat],
    metadata: bytes,
    options: CodingOptions,
    summary: RecordingSummary,
    report: Report,
) -> Iterator[Record]:
    page = page_size(data)
    checksum = _checksum(data)
    size = len(data)
    if page:
        pages = data.reshape(-1, page)
        links = compress_bytes(encode_links(pages[:, :LINK_BYTES]), are_headers=True)
        yield Record(RecordKind.PAGES, base_128(page) + links)
        size = len(pages) * (page - LINK_BYTES)
    encoder = _PacketEncoder(options)
    done = 0
    while done < size:
        window = without_links(data, page, done, min(done + _WINDOW, size))
        packets = _find(formats, window)
        if metadata and packets.places.size and packets.format is not VELODYNE:
            yield Record(RecordKind.METADATA, compress_bytes(metadata))
            summary.metadata, metadata = metadata, b""
        is_last = done + len(window) == size
        # A packet that the window cuts off is found in the next window.
        largest = max(each.span for each in formats)
        end = len(window) if is_last else max(len(window) - largest + 1, packets.end())
        batches = encoder.batches(window[:end], packets, partial(_report_at, report, done, size))
        batch = next(batch for batch in batches if _fits(batch, summary, done + end))
        summary.add(batch)
        yield from batch.records
        done += end
        report(done, size)
    yield Record(RecordKind.END, summary.bytes.to_bytes(8, "little") + checksum)


def _report_at(report: Report, done: int, size: int, within: int) -> None:
    if within:
        report(done + within, size)


def _fits(batch: _Batch, summary: RecordingSummary, done: int) -> bool:
    limits = _Limits(summary.compressed + sum(len(record.body) for record in batch.records))
    done += _FRAME_BYTES
    return summary.ranges + batch.ranges <= limits.ranges and done <= limits.bytes


def _checksum(data: Bytes) -> bytes:
    checksum = 0
    for first in range(0, len(data), _WINDOW):
        checksum = zlib.crc32(data[first : first + _WINDOW].tobytes(), checksum)
    return checksum.to_bytes(4, "little")


class _Packets(NamedTuple):
    format: PacketFormat
    places: NDArray[np.int64]

    def bytes(self) -> int:
        return sum(self.format.pieces) * len(self.places)

    def end(self) -> int:
        return int(self.places[-1]) + self.format.span if len(self.places) else 0

    def payloads(self, data: Bytes) -> Payloads:
        views = np.lib.stride_tricks.sliding_window_view(data, self.format.span)[self.places]
        starts = self.format.starts.tolist()
        pieces = zip(starts, self.format.pieces, strict=True)
        return np.concatenate([views[:, at : at + size] for at, size in pieces], axis=1)


def _find(formats: list[PacketFormat], data: Bytes) -> _Packets:
    best = _Packets(formats[0], formats[0].find(data))
    for each in formats[1:]:
        if 2 * best.bytes() > len(data):
            break
        packets = _Packets(each, each.find(data))
        best = max(best, packets, key=_Packets.bytes)
    return best


class _PacketEncoder:
    def __init__(self, options: CodingOptions) -> None:
        self._options = options
        self._packets: PacketsEncoder | None = None

    def batches(
        self, data: Bytes, packets: _Packets, report: Callable[[int], None]
    ) -> Iterator[_Batch]:
        """Yield three encodings of `data`, of which the caller uses the first within the decoder's
        limits.

        The first encodes packets as turns, the second compresses all bytes by LZMA, and the third
        stores the bytes, which is always within the limits.
        """
        yield self._batch(data, packets, report)
        self._packets = None
        gaps = [data.tobytes()]
        for encode in (encode_gaps, store_gaps):
            yield _Batch(records=[Record(RecordKind.GAPS, base_128(0) + encode(gaps))])

    def _batch(self, data: Bytes, packets: _Packets, report: Callable[[int], None]) -> _Batch:
        batch, (packet_format, places) = _Batch(), packets
        if len(places):
            for kind, payloads in packet_format.split_turns(packets.payloads(data)):
                self._add_turn(kind, payloads, batch)
                report(int(places[batch.packets - 1]))
        pieces = (places[:, None] + packet_format.starts).ravel()
        starts = np.concatenate([[0], pieces + np.tile(packet_format.pieces, len(places))])
        ends = np.concatenate([pieces, [len(data)]])
        gaps = [
            data[first:end].tobytes()
            for first, end in zip(starts.tolist(), ends.tolist(), strict=True)
        ]
        # Gaps that are larger than the packets are content of other kinds.
        are_headers = len(data) < 2 * packets.bytes()
        body = base_128(len(pieces)) + encode_gaps(gaps, are_headers)
        batch.records.append(Record(RecordKind.GAPS, body))
        return batch

    def _add_turn(self, kind: Kind, payloads: Payloads, batch: _Batch) -> None:
        if self._packets is None or kind != self._packets.kind:
            self._packets = PacketsEncoder(kind, self._options)
            batch.records.append(self._packets.layout())
        turn, records = self._packets.encode(payloads)
        batch.records += records
        batch.turns += 1
        batch.packets += len(payloads)
        batch.returns += turn.returns
        batch.ranges += count_values(kind, records[0].body)


class _RecordingWriter:
    def __init__(self, stream: IO[bytes], limits: _Limits) -> None:
        self._stream, self._limits = stream, limits
        self.checksum, self.size = 0, 0
        self._links: Bytes | None = None
        self._page, self._at = 0, 0

    def admit(self, size: int) -> None:
        self._limits.check(self._at + size, self._limits.bytes, "bytes")

    def start_pages(self, body: bytes) -> None:
        reader = Reader(body)
        page = reader.number()
        check(not self._at and not self._page and SMALLEST_PAGE <= page <= LARGEST_PAGE)
        content = page - LINK_BYTES
        links = decompress_bytes(reader, lambda size: self.admit(size // LINK_BYTES * content))
        check(len(links) % LINK_BYTES == 0)
        self._page, self._links = content, decode_links(links)

    def write(self, data: bytes) -> None:
        remaining = memoryview(data)
        while self._links is not None and remaining:
            number, within = divmod(self._at, self._page)
            if within == 0:
                check(number < len(self._links))
                self._put(self._links[number].tobytes())
            part = remaining[: self._page - within]
            self._put(part)
            self._at += len(part)
            remaining = remaining[len(part) :]
        self._put(remaining)
        self._at += len(remaining)

    def _put(self, data: bytes | memoryview) -> None:
        self.checksum = zlib.crc32(data, self.checksum)
        self.size += len(data)
        self._stream.write(data)


def _restore(
    source: IO[bytes], stream: IO[bytes], limits: _Limits, report: Report
) -> RecordingSummary:
    summary, packets = RecordingSummary(compressed=limits.size), PacketsDecoder(2 * _WINDOW)
    writer = _RecordingWriter(stream, limits)
    summary.ranges = _all_ranges(source)
    limits.check(summary.ranges, limits.ranges, "ranges")
    source.seek(0)
    for record in read_records(source):
        if record.kind != RecordKind.END:
            report(source.tell(), limits.size)
        if record.kind == RecordKind.PAGES:
            writer.start_pages(record.body)
        elif record.kind == RecordKind.LAYOUT:
            packets.start_layout(record.body)
        elif record.kind == RecordKind.TURN:
            summary.returns += packets.add_turn(record.body)
            summary.turns += 1
        elif record.kind == RecordKind.FIELDS:
            packets.add_fields(record.body)
        elif record.kind == RecordKind.METADATA:
            summary.metadata = decompress_bytes(Reader(record.body), writer.admit)
            sensor_of(summary.metadata, "its metadata")
        elif record.kind == RecordKind.GAPS:
            count, pieces = packets.take()
            summary.packets += count
            reader = Reader(record.body)
            check(reader.number() == len(pieces))
            gaps = decode_gaps(reader, len(pieces) + 1, writer.admit)
            writer.write(b"".join(chain(*zip_longest(gaps, pieces, fillvalue=b""))))
        elif record.body != _end(writer):
            raise InputError("the stream is damaged, or holds no recording")
    report(limits.size, limits.size)
    summary.bytes = writer.size
    return summary


def _end(writer: _RecordingWriter) -> bytes:
    return writer.size.to_bytes(8, "little") + writer.checksum.to_bytes(4, "little")


def _all_ranges(source: IO[bytes]) -> int:
    ranges, kind = 0, None
    for record in read_records(source):
        if record.kind == RecordKind.LAYOUT:
            kind = decode_kind(record.body)
        elif record.kind == RecordKind.TURN:
            if kind is None:
                raise InputError(DAMAGED)
            ranges += count_values(kind, record.body)
    return ranges

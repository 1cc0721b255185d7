"""Lossless compression of recordings, or of any other file.

Data packets are found by their content; the packets of a revolution are encoded as one turn.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, zip_longest
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader, base_128
from pointkit.errors import InputError, naming
from pointkit.files import open_file, written_whole
from puck.gaps import Bytes, compress_bytes, decode_gaps, decompress_bytes, encode_gaps, store_gaps
from puck.options import CodingOptions
from puck.packet_kinds import (
    Kind,
    PacketFormat,
    PacketsEncoder,
    count_values,
    decode_kind,
    formats_of,
)
from puck.recordings.packet_turns import Payloads
from puck.records import DAMAGED, Record, RecordKind, check, most_ranges, read_records, start
from puck.sensors import PacketSorter, SensorsDecoder, sensor_number, sensor_record
from puck.sqlite_pages import (
    LARGEST_PAGE,
    LINK_BYTES,
    SMALLEST_PAGE,
    decode_links,
    encode_links,
)
from puck.windows import Windows, windows_of

_WINDOW = 1 << 24
"""Number of bytes that are searched for packets at a time. Their turns form a batch."""
_MOST_BATCH_BYTES = 1 << 26
"""Maximum number of bytes of a batch's turns in a stream, which are held in memory."""
_BATCH_KINDS = (
    *(RecordKind.LAYOUT, RecordKind.TURN, RecordKind.FIELDS, RecordKind.SENSOR, RecordKind.ORDER),
)
"""Kinds of the records that precede the GAPS record of their batch."""
_MANY_BYTES, _BYTES_PER_BYTE = 3 << 24, 40
"""Limit of a restored recording's size: a constant, and more for each byte of the stream."""
_FRAME_BYTES = 16
"""Maximum number of bytes that state the length of a gap. A decoder counts them as output, too."""

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
    """

    bytes: int = 0
    compressed: int = 0
    parts: dict[str, int] = field(default_factory=dict)

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


@dataclass
class _Limits:
    """Limits of what the first `size` bytes of a stream may hold."""

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
    recording: Path | IO[bytes],
    out: Path | IO[bytes],
    options: CodingOptions | None = None,
    report: Report | None = None,
) -> RecordingSummary:
    """Compress any file so that `decompress` restores it bit for bit.

    The function finds data packets of known sensors by their content, and codes the packets of a
    revolution as one turn. LZMA compresses all other bytes. Packets of an Ouster are found only if
    the sensor's metadata (JSON) lie beside the recording. The recording is read once, in windows of
    16 MiB; memory does not grow with its size.

    Parameters
    ----------
    recording
        Packet capture, ROS bag, or any other file; or a binary stream, such as a pipe.
    out
        File to write, or a binary stream. If compression fails, no incomplete file is left; a
        stream may have taken a part.
    options
        Options of encoding. Only `effort` and `key_every` may differ from their defaults, since
        nothing may be lost.
    report
        Function that is called with the number of processed bytes and the number of all bytes, to
        show progress. It is not called for a stream, whose size is not known.

    Returns
    -------
    RecordingSummary
        Number of packets, turns and returns, and the sizes of both files in bytes.

    Raises
    ------
    InputError
        The recording cannot be read, or is an empty stream; `out` cannot be written or is the
        recording itself; or `options` are lossy.
    """
    options = options or CodingOptions()
    if options.step != 1 or not options.times or not options.reflectivities:
        raise InputError("a recording is compressed without loss and with all that is in it")
    _check_different(recording, out)
    summary = RecordingSummary()
    with windows_of(recording) as windows, _written(out) as stream:
        summary.compressed = stream.write(start())
        formats = formats_of(recording if isinstance(recording, Path) else None)
        for record in _records(windows, formats, options, summary, report):
            size = stream.write(record.packed())
            name = record.kind.name.lower()
            summary.parts[name] = summary.parts.get(name, 0) + size
            summary.compressed += size
    return summary


def decompress(
    path: Path | IO[bytes],
    out: Path | IO[bytes],
    report: Report | None = None,
    *,
    trusted: bool = False,
) -> RecordingSummary:
    """Restore a file that `compress` compressed, and verify its checksum.

    Parameters
    ----------
    path
        File that `compress` wrote (.puck); or a binary stream, such as a pipe.
    out
        File to write, or a binary stream. If decompression fails, no incomplete file is left; a
        stream may have taken a part.
    report
        Function that is called with the number of processed bytes and the number of all bytes of
        the stream, to show progress. It is not called if `path` is a stream.
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
    with _opened(path) as source, _written(out) as stream:
        return _restore(source, stream, trusted, report or _no_report)


def _check_different(source: Path | IO[bytes], out: Path | IO[bytes]) -> None:
    if not isinstance(source, Path) or not isinstance(out, Path):
        return
    if source.exists() and out.exists() and source.samefile(out):
        raise InputError(f"{out}: is the file that is read; name another one to write")


@contextmanager
def _opened(path: Path | IO[bytes]) -> Iterator[_Counted]:
    if isinstance(path, Path):
        with open_file(path) as stream, naming(path):
            yield _Counted(stream, path.stat().st_size)
    else:
        yield _Counted(path)


@contextmanager
def _written(out: Path | IO[bytes]) -> Iterator[IO[bytes]]:
    if isinstance(out, Path):
        with written_whole(out) as temporary, temporary.open("wb") as stream:
            yield stream
    else:
        yield out
        out.flush()


def _records(
    windows: Windows,
    formats: list[PacketFormat],
    options: CodingOptions,
    summary: RecordingSummary,
    report: Report | None,
) -> Iterator[Record]:
    size = windows.size or 0
    if windows.page:
        links = windows.links()
        packed = compress_bytes(encode_links(links), are_headers=True)
        yield Record(RecordKind.PAGES, base_128(windows.page) + packed)
        size = len(links) * (windows.page - LINK_BYTES)
    if report is None or windows.size is None:
        report = _no_report
    encoder, done = _PacketEncoder(options), 0
    for content, packets in search(windows, formats):
        batches = encoder.batches(content, packets, partial(_report_at, report, done, size))
        done += len(content)
        batch = next(batch for batch in batches if _fits(batch, summary, done))
        summary.add(batch)
        yield from batch.records
        report(done, size)
    summary.bytes = windows.read
    yield Record(RecordKind.END, _end(windows.read, windows.checksum))


def _no_report(done: int, size: int) -> None:
    pass


def _report_at(report: Report, done: int, size: int, within: int) -> None:
    if within:
        report(done + within, size)


def _fits(batch: _Batch, summary: RecordingSummary, done: int) -> bool:
    limits = _Limits(summary.compressed + sum(len(record.body) for record in batch.records))
    done += _FRAME_BYTES
    return summary.ranges + batch.ranges <= limits.ranges and done <= limits.bytes


class FoundPackets(NamedTuple):
    """Packets of one format that were found in a part of a recording, at ascending places."""

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

    def turns(self, data: Bytes) -> Iterator[tuple[Kind, Payloads]]:
        return self.format.split_turns(self.payloads(data)) if len(self.places) else iter(())


def search(windows: Windows, formats: list[PacketFormat]) -> Iterator[tuple[Bytes, FoundPackets]]:
    """Search a recording for packets, window by window.

    Yields
    ------
    content
        The next part of the recording's content.
    packets
        Packets in this part, of the format that covers most of it. A packet or turn that a window
        cuts off is found in the next part.
    """
    largest, is_last = max(each.span for each in formats), windows.size == 0
    while not is_last:
        window, is_last = windows.next(_WINDOW)
        packets, end = _find(formats, window), len(window)
        if not is_last:
            end = max(end - largest + 1, packets.end())
            whole = _without_last_turn(packets, window)
            if len(whole.places) < len(packets.places):
                packets, end = whole, whole.end()
        yield window[:end], packets
        windows.skip(end)


def _without_last_turn(packets: FoundPackets, window: Bytes) -> FoundPackets:
    lengths = [len(payloads) for _, payloads in packets.turns(window)]
    count = sum(lengths[:-1])
    # So that windows do not overlap by more than half.
    is_late = count and packets.places[count] > len(window) // 2
    return packets._replace(places=packets.places[:count]) if is_late else packets


def _find(formats: list[PacketFormat], data: Bytes) -> FoundPackets:
    best = FoundPackets(formats[0], formats[0].find(data))
    for each in formats[1:]:
        if 2 * best.bytes() > len(data):
            break
        packets = FoundPackets(each, each.find(data))
        best = max(best, packets, key=FoundPackets.bytes)
    return best


class _PacketEncoder:
    def __init__(self, options: CodingOptions) -> None:
        self._options, self._sorter, self._sensor = options, PacketSorter(), 0
        self._packets: dict[int, PacketsEncoder] = {}

    def batches(
        self, data: Bytes, packets: FoundPackets, report: Callable[[int], None]
    ) -> Iterator[_Batch]:
        """Yield three encodings of `data`, of which the caller uses the first within the decoder's
        limits.

        The first encodes packets as turns, the second compresses all bytes by LZMA, and the third
        stores the bytes, which is always within the limits.
        """
        sensor = self._sensor
        yield self._batch(data, packets, report)
        self._sensor = sensor
        self._packets.clear()
        gaps = [data.tobytes()]
        for encode in (encode_gaps, store_gaps):
            yield _Batch(records=[Record(RecordKind.GAPS, base_128(0) + encode(gaps))])

    def _batch(self, data: Bytes, packets: FoundPackets, report: Callable[[int], None]) -> _Batch:
        batch, (packet_format, places) = _Batch(), packets
        if len(places):
            payloads = packets.payloads(data)
            by_sensor, order = self._sorter.sort(data, packet_format, places, payloads)
            for sensor, rows in by_sensor.items():
                self._select(sensor, batch)
                for kind, part in packet_format.split_turns(payloads[rows]):
                    self._add_turn(kind, part, batch)
                    report(int(places[batch.packets - 1]))
            if order:
                batch.records.append(Record(RecordKind.ORDER, order))
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

    def _select(self, sensor: int, batch: _Batch) -> None:
        if sensor != self._sensor:
            self._sensor = sensor
            batch.records.append(sensor_record(sensor))

    def _add_turn(self, kind: Kind, payloads: Payloads, batch: _Batch) -> None:
        encoder = self._packets.get(self._sensor)
        if encoder is None or kind != encoder.kind:
            encoder = self._packets[self._sensor] = PacketsEncoder(kind, self._options)
            batch.records.append(encoder.layout())
        turn, records = encoder.encode(payloads)
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
        links = decompress_bytes(reader, lambda size: None)
        check(len(links) % LINK_BYTES == 0)
        self._page, self._links = page - LINK_BYTES, decode_links(links)

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


class _Counted:
    """Stream that counts the bytes read from it; its `size` is None for a pipe."""

    def __init__(self, stream: IO[bytes], size: int | None = None) -> None:
        self._stream, self.size, self.count = stream, size, 0

    def read(self, size: int, /) -> bytes:
        data = self._stream.read(size)
        self.count += len(data)
        return data


def _restore(
    source: _Counted, stream: IO[bytes], trusted: bool, report: Report
) -> RecordingSummary:
    summary, packets = RecordingSummary(), SensorsDecoder(2 * _WINDOW)
    limits, done = _Limits(0, trusted), 0
    writer = _RecordingWriter(stream, limits)
    for record in _within_limits(source, limits, summary):
        done += len(record.body)
        if source.size is not None:
            report(done, source.size)
        if record.kind == RecordKind.PAGES:
            writer.start_pages(record.body)
        elif record.kind in _BATCH_KINDS:
            summary.returns += packets.add(record)
            summary.turns += record.kind == RecordKind.TURN
        elif record.kind == RecordKind.GAPS:
            count, pieces = packets.take()
            summary.packets += count
            reader = Reader(record.body)
            check(reader.number() == len(pieces))
            gaps = decode_gaps(reader, len(pieces) + 1, writer.admit)
            writer.write(b"".join(chain(*zip_longest(gaps, pieces, fillvalue=b""))))
        elif record.body != _end(writer.size, writer.checksum):
            raise InputError("the stream is damaged, or holds no recording")
    if source.size is not None:
        report(source.size, source.size)
    summary.bytes, summary.compressed = writer.size, source.count
    return summary


def _within_limits(
    source: _Counted, limits: _Limits, summary: RecordingSummary
) -> Iterator[Record]:
    """Yield the records of a stream, those of a batch after all of it is read and checked."""
    batch, kinds, sensor, size = list[Record](), dict[int, Kind](), 0, 0
    for record in read_records(source):
        batch.append(record)
        if record.kind == RecordKind.SENSOR:
            sensor = sensor_number(record.body)
        elif record.kind == RecordKind.LAYOUT:
            kinds[sensor] = decode_kind(record.body)
        elif record.kind == RecordKind.TURN:
            if sensor not in kinds:
                raise InputError(DAMAGED)
            summary.ranges += count_values(kinds[sensor], record.body)
        if record.kind in _BATCH_KINDS:
            size += len(record.body)
            check(size <= _MOST_BATCH_BYTES)
            continue
        limits.size = source.count
        limits.check(summary.ranges, limits.ranges, "ranges")
        yield from batch
        batch, size = [], 0


def _end(size: int, checksum: int) -> bytes:
    return size.to_bytes(8, "little") + checksum.to_bytes(4, "little")

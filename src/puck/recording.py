"""Lossless compression of recordings, or of any other file.

Data packets and messages of point clouds are found by their content; the packets of a revolution
are encoded as one turn.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, zip_longest
from pathlib import Path
from shutil import copyfileobj
from tempfile import TemporaryFile
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader, base_128
from pointkit.coding.zstandard import compressed
from pointkit.errors import InputError, naming
from pointkit.files import open_file, written_whole
from puck.chunks import ChunkPacker
from puck.cloud_messages import FoundCloud, find_clouds
from puck.cloud_streams import CloudsDecoder, CloudsEncoder, cloud_ranges
from puck.gaps import (
    Bytes,
    compress_bytes,
    decode_gaps,
    decompress_bytes,
    encode_gaps,
    store_gaps,
)
from puck.metadata import MOST_METADATA, MetadataUse
from puck.options import CodingOptions
from puck.packet_kinds import (
    Kind,
    PacketFormat,
    PacketsEncoder,
    count_values,
    decode_kind,
)
from puck.recordings.ouster import sensor_of, write_metadata_beside
from puck.recordings.packet_turns import Payloads
from puck.records import DAMAGED, Record, RecordKind, check, most_ranges, read_records, start
from puck.sensors import LocatedPackets, PacketSorter, SensorsDecoder, sensor_number, sensor_record
from puck.sqlite_pages import LARGEST_PAGE, LINK_BYTES, SMALLEST_PAGE, decode_links
from puck.sqlite_payloads import PageWriter
from puck.windows import Windows, windows_of

_WINDOW = 1 << 24
"""Number of bytes that are searched at a time. Their turns and clouds form a batch."""
_MOST_BATCH_BYTES = 1 << 26
"""Maximum number of bytes of a batch's turns in a stream, which are held in memory."""
_MANY_BYTES, _BYTES_PER_BYTE = 3 << 24, 40
"""Limit of a restored recording's size: a constant, and more for each byte of the stream."""
_MOST_LEFT = 8
"""Inverse of the share of bytes outside packets below which no more packets are searched for."""
_ALWAYS_PLAIN, _QUICKLY, _CLOSE = 1 << 18, 1, 2.5
"""How it is decided whether clouds are compressed by LZMA alone as well; the smaller result is
kept. Up to the first number of bytes, they always are, since models learn little from so few.
More bytes are compressed by this level of Zstandard; they are if the result is less than the third
number times the size with models."""
_FRAME_BYTES = 16
"""Maximum number of bytes that state the length of a gap. A decoder counts them as output, too."""

_PORTION = 1 << 20
_PACKET_KINDS = (
    *(RecordKind.LAYOUT, RecordKind.TURN, RecordKind.FIELDS, RecordKind.SENSOR, RecordKind.ORDER),
)
_BATCH_KINDS = (
    *_PACKET_KINDS,
    RecordKind.CLOUD_LAYOUT,
    RecordKind.CLOUD,
    RecordKind.PLACES,
)
"""Kinds of the records that precede the GAPS record of their batch."""

Pieces = NDArray[np.int64]
"""First byte, and first byte after the end, of parts of a recording, (n, 2)."""
Content = bytes
Report = Callable[[int, int], None]
"""Function that is called with the number of processed bytes and the number of all bytes."""


@dataclass(kw_only=True)
class _Counts:
    packets: int = 0
    turns: int = 0
    returns: int = 0
    ranges: int = 0
    clouds: int = 0
    points: int = 0
    packets_by_lzma: int = 0
    clouds_by_lzma: int = 0

    def add(self, other: _Counts) -> None:
        self.packets += other.packets
        self.turns += other.turns
        self.returns += other.returns
        self.ranges += other.ranges
        self.clouds += other.clouds
        self.points += other.points
        self.packets_by_lzma += other.packets_by_lzma
        self.clouds_by_lzma += other.clouds_by_lzma


@dataclass(kw_only=True)
class RecordingSummary(_Counts):
    """Counts of what a recording holds, and its sizes before and after compression.

    Parameters
    ----------
    packets, turns, returns
        Number of data packets, number of turns (revolutions) that they form, and number of returns
        in these turns.
    ranges
        Number of pixels of range images, with and without a return, plus pixels of other images
        and values of clouds. Decoders limit this number.
    clouds, points
        Number of messages of the type PointCloud2, and number of points in them.
    packets_by_lzma, clouds_by_lzma
        Numbers of packets and messages that were found, but are not among `packets` and `clouds`:
        LZMA compresses them like other bytes, since models would take more bytes or exceed a
        decoder's limits. A decoder does not know these numbers; they are 0.
    bytes, compressed
        Size of the recording and size of its stream, in bytes.
    parts
        Number of bytes of the stream by kind of record.
    opened, kept
        Number of compressed chunks (of ROS 1 bags and MCAP files) that were opened, and number of
        those that were not, because compressing them again would give other bytes.
    metadata
        Content of the JSON file that describes an Ouster sensor, if it is in the stream.
    """

    bytes: int = 0
    compressed: int = 0
    parts: dict[str, int] = field(default_factory=dict)
    opened: int = 0
    kept: int = 0
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
            "clouds": self.clouds,
            "points": self.points,
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

    @property
    def size(self) -> int:
        return sum(len(record.body) for record in self.records)


def compress(
    recording: Path | IO[bytes],
    out: Path | IO[bytes],
    options: CodingOptions | None = None,
    report: Report | None = None,
) -> RecordingSummary:
    """Compress any file so that `decompress` restores it bit for bit.

    The function finds data packets of known sensors and messages of the type PointCloud2 by their
    content, and codes the packets of a revolution as one turn. LZMA compresses all other bytes.
    Packets of an Ouster are found only if the sensor's metadata are in the recording, which is a
    bag, or in a JSON file beside it. The stream then contains this file. Compressed chunks of bags
    are opened if compressing them again gives the same bytes. The recording is read once, in
    windows of 16 MiB; memory does not grow with its size.

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
        Number of packets, turns, returns and clouds, and the sizes of both files in bytes.

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
        path = recording if isinstance(recording, Path) else None
        metadata = MetadataUse(path)
        for record in _records(windows, metadata, options, summary, report):
            size = stream.write(record.packed())
            name = record.kind.name.lower()
            summary.parts[name] = summary.parts.get(name, 0) + size
            summary.compressed += size
        summary.bytes, summary.opened, summary.kept = windows.read, windows.opened, windows.kept
        if not summary.packets and not summary.packets_by_lzma and not summary.clouds:
            metadata.tell_unused()
    return summary


def decompress(
    path: Path | IO[bytes],
    out: Path | IO[bytes],
    report: Report | None = None,
    *,
    trusted: bool = False,
) -> RecordingSummary:
    """Restore a file that `compress` compressed, and verify its checksum.

    If the stream contains an Ouster's metadata, they are written beside the file with the suffix
    ``.json``, unless metadata lie there already. A warning tells if these are others.

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
        Number of packets, turns, returns and clouds, and the sizes of both files in bytes.

    Raises
    ------
    InputError
        The stream is damaged, or of another format or version; the restored file would be too
        large; or a file cannot be read or written.
    """
    _check_different(path, out)
    with _opened(path) as source, _written(out) as stream:
        summary = _restore(source, stream, trusted, report or _no_report)
    if summary.metadata and isinstance(out, Path):
        write_metadata_beside(out, summary.metadata)
    return summary


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
        with written_whole(out) as temporary, temporary.open("w+b") as stream:
            yield stream
    else:
        yield out
        out.flush()


def _records(
    windows: Windows,
    metadata: MetadataUse,
    options: CodingOptions,
    summary: RecordingSummary,
    report: Report | None,
) -> Iterator[Record]:
    yield from windows.header
    if report is None or windows.size is None:
        report = _no_report
    encoder, done = _BatchEncoder(options), 0
    for window in search(windows, metadata.formats):
        yield from windows.take_records()
        for each in window.packets:
            if metadata.describes(each.format) and (
                content := metadata.take(each.located(window.data))
            ):
                yield Record(RecordKind.METADATA, compress_bytes(content))
                summary.metadata = content
        batches = encoder.batches(window, partial(_report_at, report, windows, done))
        done += len(window.data)
        batch = next(batch for batch in batches if _fits(batch, summary, done))
        summary.add(batch)
        yield from batch.records
        report(*windows.progress(done))
    yield Record(RecordKind.END, _end(windows.read, windows.checksum))


def _no_report(done: int, size: int) -> None:
    pass


def _report_at(report: Report, windows: Windows, done: int, within: int) -> None:
    if within:
        report(*windows.progress(done + within))


def _fits(batch: _Batch, summary: RecordingSummary, done: int) -> bool:
    limits = _Limits(summary.compressed + batch.size)
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
        pieces = zip(self.format.starts.tolist(), self.format.pieces, strict=True)
        return np.concatenate([views[:, at : at + size] for at, size in pieces], axis=1)

    def located(self, data: Bytes) -> LocatedPackets:
        return LocatedPackets(self.format, self.places, self.payloads(data))

    def turns(self, data: Bytes) -> Iterator[tuple[Kind, Payloads]]:
        return self.format.split_turns(self.payloads(data)) if len(self.places) else iter(())

    def pieces(self) -> Pieces:
        starts = (self.places[:, None] + self.format.starts).ravel()
        return np.stack([starts, starts + np.tile(self.format.pieces, len(self.places))], axis=1)

    def spans(self) -> Pieces:
        return np.stack([self.places, self.places + self.format.span], axis=1)

    def before(self, end: int) -> FoundPackets:
        """Return the packets that lie before a position."""
        return self._replace(places=self.places[self.places + self.format.span <= end])

    def outside(self, clouds: Pieces) -> FoundPackets:
        """Return the packets that have no byte in common with the clouds."""
        before = np.searchsorted(clouds[:, 1], self.places, side="right")
        ends = np.append(clouds[:, 0], np.iinfo(np.int64).max)
        return self._replace(places=self.places[self.places + self.format.span <= ends[before]])


class Window(NamedTuple):
    """Part of a recording's content, and what was found in it.

    Packets of several formats have no byte in common; those of which there are most come first.
    """

    data: Bytes
    packets: list[FoundPackets]
    clouds: list[FoundCloud]


def search(windows: Windows, formats: list[PacketFormat]) -> Iterator[Window]:
    """Search a recording for packets and clouds, and yield it window by window.

    A packet, turn or cloud that a window cuts off is found in the next window.
    """
    is_last = windows.size == 0
    while not is_last:
        data, clouds, cut, is_last = _next_window(windows)
        packets = _find(formats, data, _pieces_of(clouds if cut is None else [*clouds, cut]))
        end = len(data)
        if not is_last:
            largest = max(each.span for each in formats)
            end = end - largest + 1 if cut is None else cut.head
            end = max([end, *(each.end() for each in packets), *(cloud.end for cloud in clouds)])
            if packets and not clouds and cut is None:
                whole = _without_last_turn(packets[0], data)
                if len(whole.places) < len(packets[0].places):
                    end = whole.end()
                    packets = [each.before(end) for each in packets]
        yield Window(data[:end], packets, clouds)
        windows.skip(end)


def _next_window(windows: Windows) -> tuple[Bytes, list[FoundCloud], FoundCloud | None, bool]:
    """Return a part of the content, its clouds, the cloud that it cuts off, and if it is the last.

    The part is longer than usual if the cloud that is cut off begins early.
    """
    size = _WINDOW
    while True:
        data, is_last = windows.next(size)
        clouds = list(find_clouds(data.tobytes()))
        cut = clouds.pop() if clouds and clouds[-1].end > len(data) else None
        if cut is None or is_last or cut.head > _WINDOW // 2:
            return data, clouds, cut, is_last
        size = cut.end


def _pieces_of(clouds: list[FoundCloud]) -> Pieces:
    return np.array([(cloud.start, cloud.end) for cloud in clouds], np.int64).reshape(-1, 2)


def _without_last_turn(packets: FoundPackets, window: Bytes) -> FoundPackets:
    lengths = [len(payloads) for _, payloads in packets.turns(window)]
    count = sum(lengths[:-1])
    # So that windows do not overlap by more than half.
    is_late = count and packets.places[count] > len(window) // 2
    return packets._replace(places=packets.places[:count]) if is_late else packets


def _find(formats: list[PacketFormat], data: Bytes, clouds: Pieces) -> list[FoundPackets]:
    """Return the packets of each format outside clouds and packets of formats with more bytes.

    Formats are not searched for when few bytes are left.
    """
    found, left = list[FoundPackets](), len(data) - int(np.diff(clouds).sum())
    for each in formats:
        if found and _MOST_LEFT * left <= len(data):
            break
        packets = FoundPackets(each, each.find(data)).outside(clouds)
        if len(packets.places):
            found.append(packets)
            left -= packets.bytes()
    found.sort(key=FoundPackets.bytes, reverse=True)
    kept, taken = list[FoundPackets](), clouds
    for packets in found:
        outside = packets.outside(taken)
        if len(outside.places):
            kept.append(outside)
            taken = _sorted_pieces([taken, outside.spans()])
    return kept


def _sorted_pieces(parts: list[Pieces]) -> Pieces:
    pieces = np.concatenate(parts)
    return pieces[np.argsort(pieces[:, 0])]


def _gaps_of(content: bytes, encode: Callable[[list[bytes]], bytes]) -> _Batch:
    return _Batch(records=[Record(RecordKind.GAPS, base_128(0) + encode([content]))])


def _instead_of(batch: _Batch, other: _Batch) -> _Batch:
    """Return a batch without models, which counts what the batch with models has."""
    other.packets_by_lzma, other.clouds_by_lzma = batch.packets, batch.clouds
    return other


class _BatchEncoder:
    def __init__(self, options: CodingOptions) -> None:
        self._options, self._sorter, self._sensor = options, PacketSorter(), 0
        self._packets: dict[int, PacketsEncoder] = {}
        self._clouds = CloudsEncoder(options)

    def batches(self, window: Window, report: Callable[[int], None]) -> Iterator[_Batch]:
        """Yield encodings of a window, of which the caller uses the first within the
        decoder's limits.

        The first encodes packets as turns, and clouds, and is left out if it is larger than the
        second, which compresses all bytes by LZMA. The third stores the bytes, which is always
        within the limits.
        """
        sensor = self._sensor
        batch, content = self._batch(window, report), window.data.tobytes()
        plain = None
        if window.clouds and (
            len(content) <= _ALWAYS_PLAIN
            or len(compressed(content, _QUICKLY, long=True)) < _CLOSE * batch.size
        ):
            plain = _gaps_of(content, encode_gaps)
        if plain is None or batch.size <= plain.size:
            yield batch
        self._sensor = sensor
        self._packets.clear()
        self._clouds = CloudsEncoder(self._options)
        yield _instead_of(batch, plain or _gaps_of(content, encode_gaps))
        yield _instead_of(batch, _gaps_of(content, store_gaps))

    def _batch(self, window: Window, report: Callable[[int], None]) -> _Batch:
        batch, (data, packets, clouds) = _Batch(), window
        packets = self._add_packets(data, packets, batch, report)
        for cloud in clouds:
            batch.records += self._clouds.encode(cloud, data[cloud.start : cloud.end].tobytes())
            batch.clouds += 1
            batch.points += cloud.points
            batch.ranges += cloud_ranges(cloud.end - cloud.start)
            report(cloud.start)
        pieces = _sorted_pieces([*(each.pieces() for each in packets), _pieces_of([])])
        places = _pieces_of(clouds)
        if len(pieces) and clouds:
            body = b"".join(map(base_128, np.searchsorted(pieces[:, 0], places[:, 0]).tolist()))
            batch.records.append(Record(RecordKind.PLACES, body))
        pieces = _sorted_pieces([pieces, places])
        edges = [0, *pieces.ravel().tolist(), len(data)]
        gaps = [
            data[first:end].tobytes() for first, end in zip(edges[::2], edges[1::2], strict=True)
        ]
        # Gaps that are larger than the packets are content of other kinds.
        are_headers = len(data) < 2 * sum(each.bytes() for each in packets)
        body = base_128(len(pieces)) + encode_gaps(gaps, are_headers)
        batch.records.append(Record(RecordKind.GAPS, body))
        return batch

    def _add_packets(
        self, data: Bytes, packets: list[FoundPackets], batch: _Batch, report: Callable[[int], None]
    ) -> list[FoundPackets]:
        """Add the records of packets to a batch, and return the packets, of which some may be left
        out.
        """
        located = [each.located(data) for each in packets]
        by_sensor, order, formats = self._sorter.sort(data, located)
        places = np.sort(
            np.concatenate([np.zeros(1, np.int64), *(located[k].places for k in formats)])
        )
        for sensor, (number, rows) in by_sensor.items():
            self._select(sensor, batch)
            form, _, payloads = located[number]
            for kind, part in form.split_turns(payloads[rows]):
                self._add_turn(kind, part, batch)
                report(int(places[batch.packets]))
        if order:
            batch.records.append(Record(RecordKind.ORDER, order))
        return [packets[k] for k in formats]

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
    def __init__(self, stream: IO[bytes], limits: _Limits, whole: _Limits | None) -> None:
        self._stream, self._limits, self._whole = stream, limits, whole
        self._out = stream
        self._chunks, self._pages = ChunkPacker(), PageWriter()
        self._at, self._position = 0, 0
        self._checksum, self._is_in_order, self._has_payloads = 0, True, False
        self.size = 0

    def admit(self, size: int) -> None:
        self._limits.check(self._at + size, self._limits.bytes, "bytes")

    def start_pages(self, body: bytes) -> None:
        reader = Reader(body)
        page = reader.number()
        check(not self._at and not self._pages.page and SMALLEST_PAGE <= page <= LARGEST_PAGE)
        links = decompress_bytes(reader, lambda size: None)
        check(len(links) % LINK_BYTES == 0)
        self._pages = PageWriter(page, decode_links(links))
        if self._whole is not None:
            self._whole.check(self._pages.content_size, self._whole.bytes, "bytes")

    def start_payloads(self, body: bytes) -> None:
        check(not self._at and not self._has_payloads)
        self._has_payloads = True
        self._pages.set_payloads(body)
        if not self._stream.seekable():
            self._out = TemporaryFile()  # noqa: SIM115 (closed by `close`)

    def start_chunks(self, body: bytes) -> None:
        self._chunks.add_record(body)

    def write(self, data: bytes) -> None:
        self._at += len(data)
        for part in self._chunks.pack(data):
            for place, piece in self._pages.pieces(part):
                self._put(place, piece)

    def _put(self, place: int, data: bytes | memoryview) -> None:
        if place != self._position:
            self._is_in_order = False
            self._out.seek(place)
        elif self._is_in_order:
            self._checksum = zlib.crc32(data, self._checksum)
        self._out.write(data)
        self._position = place + len(data)
        self.size += len(data)

    def finish(self, end: bytes) -> None:
        """Verify the number of bytes and their checksum, which are the body of an END record."""
        check(self._pages.is_whole(self.size))
        if not self._is_in_order:
            self._checksum = 0
            self._out.seek(0)
            while part := self._out.read(_PORTION):
                self._checksum = zlib.crc32(part, self._checksum)
        if end != _end(self.size, self._checksum):
            fault = "the stream is damaged, or holds no recording"
            if others := self._chunks.other_versions():
                fault = f"chunks can only be compressed as they were by {others}"
            raise InputError(fault)
        if self._out is not self._stream:
            self._out.seek(0)
            copyfileobj(self._out, self._stream)

    def close(self) -> None:
        """Delete the temporary copy of a recording whose pages are not written in their order."""
        if self._out is not self._stream:
            self._out.close()


class _Counted:
    """Stream that counts the bytes read from it; its `size` is None for a pipe."""

    def __init__(self, stream: IO[bytes], size: int | None = None) -> None:
        self._stream, self.size, self.count = stream, size, 0

    def read(self, size: int, /) -> bytes:
        data = self._stream.read(size)
        self.count += len(data)
        return data


class _Restorer:
    """Decoder of the records of a recording, in the order of the stream."""

    def __init__(
        self,
        stream: IO[bytes],
        limits: _Limits,
        whole: _Limits | None,
        summary: RecordingSummary,
    ) -> None:
        self._limits, self._summary = limits, summary
        self.writer = writer = _RecordingWriter(stream, limits, whole)
        self._packets = SensorsDecoder(2 * _WINDOW)
        self._clouds = CloudsDecoder(self._admit_cloud)
        self._places = b""
        self._handlers: dict[RecordKind, Callable[[bytes], None]] = {
            RecordKind.PAGES: writer.start_pages,
            RecordKind.PAYLOADS: writer.start_payloads,
            RecordKind.CHUNKS: writer.start_chunks,
            RecordKind.METADATA: self._add_metadata,
            RecordKind.CLOUD_LAYOUT: self._clouds.start_layout,
            RecordKind.CLOUD: self._add_cloud,
            RecordKind.PLACES: self._add_places,
            RecordKind.GAPS: self._add_gaps,
        }

    def add(self, record: Record) -> None:
        if record.kind in _PACKET_KINDS:
            self._summary.returns += self._packets.add(record)
            self._summary.turns += record.kind == RecordKind.TURN
        else:
            self._handlers.get(record.kind, self.writer.finish)(record.body)

    def _admit_cloud(self, size: int) -> None:
        self._summary.ranges += cloud_ranges(size)
        self._limits.check(self._summary.ranges, self._limits.ranges, "ranges")

    def _add_metadata(self, body: bytes) -> None:
        check(not self._summary.metadata)
        metadata = decompress_bytes(Reader(body), lambda size: check(size <= MOST_METADATA))
        sensor_of(metadata, "its metadata")
        self._summary.metadata = metadata

    def _add_cloud(self, body: bytes) -> None:
        self._summary.points += self._clouds.add_cloud(body)
        self._summary.clouds += 1

    def _add_places(self, body: bytes) -> None:
        self._places = body

    def _add_gaps(self, body: bytes) -> None:
        count, pieces = self._packets.take()
        self._summary.packets += count
        pieces = _with_clouds(pieces, self._clouds.take(), self._places)
        self._places = b""
        reader = Reader(body)
        check(reader.number() == len(pieces))
        gaps = decode_gaps(reader, len(pieces) + 1, self.writer.admit)
        self.writer.write(b"".join(chain(*zip_longest(gaps, pieces, fillvalue=b""))))


def _restore(
    source: _Counted, stream: IO[bytes], trusted: bool, report: Report
) -> RecordingSummary:
    summary, limits, done = RecordingSummary(), _Limits(0, trusted), 0
    whole = None if source.size is None else _Limits(source.size, trusted)
    restorer = _Restorer(stream, limits, whole, summary)
    with closing(restorer.writer) as writer:
        for record in _within_limits(source, limits, summary):
            done += len(record.body)
            if source.size is not None:
                report(done, source.size)
            restorer.add(record)
    if source.size is not None:
        report(source.size, source.size)
    summary.bytes, summary.compressed = writer.size, source.count
    return summary


def _with_clouds(pieces: list[bytes], clouds: list[bytes], places: bytes) -> list[bytes]:
    """Return the pieces of packets and the clouds in their order in the recording.

    `places` are the numbers of pieces before each cloud, and empty if there are only pieces or only
    clouds.
    """
    if not places:
        check(not pieces or not clouds)
        return pieces or clouds
    reader, first, together = Reader(places), 0, []
    for cloud in clouds:
        end = reader.number()
        check(first <= end <= len(pieces))
        together += [*pieces[first:end], cloud]
        first = end
    check(not reader.rest())
    return [*together, *pieces[first:]]


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

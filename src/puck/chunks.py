"""Compressed chunks of ROS 1 bags and MCAP files, opened where compression can be repeated.

A chunk is replaced by its content if compressing it again gives the same bytes. Versions of lz4 and
Zstandard differ in their bytes, so that a stream states the versions with which this was found.
"""

from __future__ import annotations

import bz2
import re
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

from pointkit.coding.byte_io import Reader, base_128
from pointkit.errors import InputError
from puck.gaps import MOST_RAW_BYTES
from puck.records import DAMAGED, Readable, Record, RecordKind, check, read_up_to

_MCAP, _ROS1 = b"\x89MCAP0\r\n", b"#ROSBAG V2.0\n"
MAGICS = (_MCAP, _ROS1)
"""First bytes of the files that can have compressed chunks."""
_MCAP_HEAD, _MCAP_CHUNK, _MCAP_CHUNK_HEAD = 9, 6, 28
_LONGEST_HEADER = 1 << 16
_PORTION = 1 << 20
_MOST_FACTOR, _FEW_BYTES = 32, 1 << 16
"""Limit of the content of a chunk: so many bytes for each compressed byte, and more."""
_MOST_OPENED_FACTOR, _FEW_OPENED_BYTES = 16, 1 << 24
"""Limit of the content of all chunks, for each byte of the file so far, and more. It is far below
the limit of a decoder, which is in bytes of the stream."""
_TRIALS = 2
"""Number of a file's first chunks for which all usual levels are tried."""
_MOST_PACKERS = 256


class Chunk(NamedTuple):
    """Compressed chunk: name of the compression, compressed bytes, and size of its content."""

    compression: str
    data: bytes
    size: int


def _parts(stream: Readable, magic: bytes) -> Iterator[bytes | Chunk]:
    """Yield the bytes of a file, of which some are a chunk; the stream is after the magic."""
    yield magic
    yield from (_mcap_parts if magic == _MCAP else _ros1_parts)(stream)
    while rest := stream.read(_PORTION):
        yield rest


def _mcap_parts(stream: Readable) -> Iterator[bytes | Chunk]:
    while head := read_up_to(stream, _MCAP_HEAD):
        yield head
        length = int.from_bytes(head[1:], "little")
        if head[0] != _MCAP_CHUNK or length > MOST_RAW_BYTES:
            yield from _copied(stream, length)
            continue
        body = read_up_to(stream, length)
        reader = Reader(body)
        try:
            times_and_size = reader.take(_MCAP_CHUNK_HEAD)
            name = reader.take(int.from_bytes(reader.take(4), "little"))
            length = int.from_bytes(reader.take(8), "little")
            first, data = reader.at, reader.take(length)
        except InputError:
            yield body
            continue
        size = int.from_bytes(times_and_size[16:24], "little")
        yield body[:first]
        yield Chunk(name.decode("ascii", "replace"), data, size)
        yield reader.rest()


def _ros1_parts(stream: Readable) -> Iterator[bytes | Chunk]:
    while length := read_up_to(stream, 4):
        yield length
        header = read_up_to(stream, min(int.from_bytes(length, "little"), _LONGEST_HEADER))
        yield header
        length = read_up_to(stream, 4)
        yield length
        fields, size = _ros1_fields(header), int.from_bytes(length, "little")
        if fields.get(b"op") != b"\5" or size > MOST_RAW_BYTES:
            yield from _copied(stream, size)
            continue
        data = read_up_to(stream, size)
        compression = fields.get(b"compression", b"").decode("ascii", "replace")
        yield Chunk(compression, data, int.from_bytes(fields.get(b"size", b""), "little"))


def _ros1_fields(header: bytes) -> dict[bytes, bytes]:
    reader, fields = Reader(header), {}
    try:
        while reader.at < len(header):
            name, _, value = reader.take(int.from_bytes(reader.take(4), "little")).partition(b"=")
            fields[name] = value
    except InputError:
        return {}
    return fields


def _copied(stream: Readable, length: int) -> Iterator[bytes]:
    while length > 0 and (part := stream.read(min(length, _PORTION))):
        yield part
        length -= len(part)


class Packer(NamedTuple):
    """Compression of a chunk that can be repeated: method, its version, level and further flags."""

    method: str
    version: str
    level: int
    flags: int

    def pack(self, content: bytes) -> bytes:
        """Return the content of a chunk compressed."""
        try:
            return _METHODS[self.method].pack(content, self.level, self.flags)
        except (ValueError, RuntimeError) as error:  # flags that no chunk has
            raise InputError(DAMAGED) from error

    def packed(self) -> bytes:
        """Return the packer as bytes, which `unpacked` reads."""
        text = f"{self.method} {self.version} {self.level} {self.flags}".encode()
        return base_128(len(text)) + text

    @classmethod
    def unpacked(cls, reader: Reader) -> Packer:
        """Read and return a packer; raise InputError if the bytes are damaged."""
        try:
            method, version, level, flags = reader.take(reader.number()).decode("ascii").split(" ")
            packer = cls(method, version, int(level), int(flags))
        except ValueError as error:
            raise InputError(DAMAGED) from error
        check(re.fullmatch("[0-9.]{1,16}", version) is not None)
        check(method in _METHODS and packer.level in _METHODS[method].levels)
        check(0 <= packer.flags < 256)
        return packer


@dataclass(frozen=True)
class _Method:
    levels: tuple[int, ...]  # in the order in which they are tried
    version: Callable[[], str]
    flags: Callable[[bytes], int]
    unpack: Callable[[bytes, int], bytes]
    pack: Callable[[bytes, int, int], bytes]


def _lz4_flags(data: bytes) -> int:
    from lz4.frame import get_frame_info

    info = get_frame_info(data)
    flags = (info["block_linked"], info["content_checksum"], info["block_checksum"])
    has_size = bool(info["content_size"])
    return int(info["block_size_id"]) | sum(
        bool(flag) << bit for bit, flag in enumerate((*flags, has_size), 3)
    )


def _lz4_unpacked(data: bytes, size: int) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    return bytes(LZ4FrameDecompressor().decompress(data, size + 1))


def _lz4_packed(content: bytes, level: int, flags: int) -> bytes:
    from lz4.frame import compress

    packed = compress(
        content,
        compression_level=level,
        block_size=flags & 7,
        block_linked=bool(flags & 8),
        content_checksum=bool(flags & 16),
        block_checksum=bool(flags & 32),
        store_size=bool(flags & 64),
    )
    return bytes(packed)


def _lz4_version() -> str:
    from lz4 import library_version_string

    return str(library_version_string())


def _zstd_flags(data: bytes) -> int:
    descriptor = data[4]
    has_size = bool(descriptor >> 6 or descriptor & 32)
    return bool(descriptor & 4) | has_size << 1


def _zstd_unpacked(data: bytes, size: int) -> bytes:
    from pointkit.coding.zstandard import decompressed

    return decompressed(data, size)


def _zstd_packed(content: bytes, level: int, flags: int) -> bytes:
    from pointkit.coding.zstandard import compressed

    return compressed(content, level, has_checksum=bool(flags & 1), has_size=bool(flags & 2))


def _zstd_version() -> str:
    from pointkit.coding.zstandard import version

    return version()


_METHODS = {
    "bz2": _Method(
        (0,),
        lambda: "1",
        lambda data: int(data[3:4]),
        lambda data, size: bz2.BZ2Decompressor().decompress(data, size + 1),
        lambda content, level, flags: bz2.compress(content, flags),
    ),
    "lz4": _Method((0, 3, 9, 12, 1, 4, 6), _lz4_version, _lz4_flags, _lz4_unpacked, _lz4_packed),
    "zstd": _Method(
        (3, 1, -3, -5, 5, 2, 9), _zstd_version, _zstd_flags, _zstd_unpacked, _zstd_packed
    ),
}
"""Methods of compression by their names in bags. The method bz2 states its level in the flags."""


@cache
def _version(method: str) -> str:
    return _METHODS[method].version()


class ChunkOpener:
    """Stream of a file whose compressed chunks are replaced by their content, where possible.

    Parameters
    ----------
    stream
        The file, after its magic number.
    magic
        The magic number, one of `MAGICS`.

    Attributes
    ----------
    opened, kept
        Numbers of compressed chunks that were replaced by their content, and that were not.
    """

    def __init__(self, stream: Readable, magic: bytes) -> None:
        self._parts = _parts(stream, magic)
        self._part = memoryview(b"")
        self._packers: list[Packer] = []
        self._known = 0  # packers that a record already stated
        self._trials: Counter[str] = Counter()
        self._places: list[tuple[int, int, int]] = []
        self._read, self._at, self._end = 0, 0, 0
        self.opened, self.kept = 0, 0

    def read(self, size: int) -> bytes:
        """Return at most `size` bytes, and none only at the end."""
        while not self._part:
            part = next(self._parts, None)
            if part is None:
                return b""
            self._read += len(part.data if isinstance(part, Chunk) else part)
            self._part = memoryview(self._opened(part) if isinstance(part, Chunk) else part)
            self._at += len(self._part)
        first, self._part = self._part[:size], self._part[size:]
        return bytes(first)

    def take_records(self) -> list[Record]:
        """Return a record of the chunks that were opened since the last call, if there are any."""
        if not self._places:
            return []
        packers = self._packers[self._known :]
        body = [base_128(len(packers)), *(each.packed() for each in packers)]
        body += [base_128(number) for place in self._places for number in place]
        self._known, self._places = len(self._packers), []
        return [Record(RecordKind.CHUNKS, b"".join(body))]

    def _opened(self, chunk: Chunk) -> bytes:
        if chunk.compression in {"", "none"}:
            return chunk.data
        content, packer = self._unpacked(chunk)
        is_new = packer not in self._packers
        if packer is None or (is_new and len(self._packers) == _MOST_PACKERS):
            self.kept += 1
            return chunk.data
        self.opened += 1
        if is_new:
            self._packers.append(packer)
        self._places.append((self._at - self._end, len(content), self._packers.index(packer)))
        self._end = self._at + len(content)
        return content

    def _unpacked(self, chunk: Chunk) -> tuple[bytes, Packer | None]:
        method = _METHODS.get(chunk.compression)
        most = min(MOST_RAW_BYTES, _FEW_BYTES + _MOST_FACTOR * len(chunk.data))
        most = min(most, _FEW_OPENED_BYTES + _MOST_OPENED_FACTOR * self._read - self._at)
        if method is None or not 0 < chunk.size <= most:
            return b"", None
        known = [each.level for each in self._packers if each.method == chunk.compression][-1:]
        levels = known
        if not known and self._trials[chunk.compression] < _TRIALS:
            self._trials[chunk.compression] += 1
            levels = list(method.levels)
        try:
            content, flags = method.unpack(chunk.data, chunk.size), method.flags(chunk.data)
        except (InputError, OSError, ValueError, RuntimeError):
            return b"", None
        for level in levels if len(content) == chunk.size else ():
            packer = Packer(chunk.compression, _version(chunk.compression), level, flags)
            if packer.pack(content) == chunk.data:
                return content, packer
        return b"", None


class ChunkPacker:
    """Compressor of the chunks that a `ChunkOpener` opened."""

    def __init__(self) -> None:
        self._packers: list[Packer] = []
        self._chunks: deque[tuple[int, int, Packer]] = deque()
        self._at, self._end = 0, 0
        self._content = bytearray()

    def add_record(self, body: bytes) -> None:
        """Read the body of a CHUNKS record; the chunks must begin after the bytes packed so far."""
        reader = Reader(body)
        packers = [Packer.unpacked(reader) for _ in range(min(reader.number(), len(body)))]
        self._packers += packers
        check(len(self._packers) <= _MOST_PACKERS)
        while reader.at < len(body):
            start = self._end + reader.number()
            size, packer = reader.number(), reader.number()
            check(packer < len(self._packers) and 0 < size <= MOST_RAW_BYTES and start >= self._at)
            self._chunks.append((start, size, self._packers[packer]))
            self._end = start + size

    def pack(self, data: bytes) -> Iterator[bytes | memoryview]:
        """Yield the file's bytes for the next bytes of the `ChunkOpener`."""
        rest = memoryview(data)
        while rest:
            start, size, packer = self._chunks[0] if self._chunks else (1 << 62, 0, None)
            is_inside = self._at >= start
            part = rest[: (start + size if is_inside else start) - self._at]
            self._at, rest = self._at + len(part), rest[len(part) :]
            if packer is None or not is_inside:
                yield part
                continue
            self._content += part
            if self._at == start + size:
                self._chunks.popleft()
                yield packer.pack(bytes(self._content))
                self._content.clear()

    def other_versions(self) -> str:
        """Return the compressors that the stream used and that have another version here."""
        names = {
            f"{each.method} {each.version}"
            for each in self._packers
            if each.version != _version(each.method)
        }
        return ", ".join(sorted(names))

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from io import SEEK_CUR
from pathlib import Path
from struct import Struct, error
from typing import IO

from puckbench.core.files import unreadable

_MCAP, _ROS1 = b"\x89MCAP0\r\n", b"#ROSBAG V2.0\n"
_RECORD, _CHUNK, _LENGTH = Struct("<BQ"), Struct("<28xI"), Struct("<I")
"""In MCAP: kind and length of a record; length of a chunk's compression name. In ROS 1: length of a
header or of data."""
_CHUNK_KIND = 6
_NAME = b"compression="
_MAX_NAME, _MAX_HEADER = 20, 4096


def compressed_chunks(path: Path) -> dict[str, int]:
    """Return the number of bytes in compressed chunks, by name of the compression (``zstd``).

    The search ends at a damaged record. Files of other formats have no chunks.
    """
    counts: Counter[str] = Counter()
    try:
        with path.open("rb") as stream:
            size = path.stat().st_size
            chunks = _mcap_chunks if stream.read(len(_MCAP)) == _MCAP else _ros1_chunks
            for compression, count in chunks(stream, size):
                name = compression[:_MAX_NAME].decode(errors="replace")
                counts[name if name.isalnum() else repr(name)] += count
    except OSError as fault:
        raise unreadable(path, fault) from fault
    except error:  # a record at the end is cut off
        pass
    return {name: counts[name] for name in sorted(counts) if name not in ("''", "none")}


def _mcap_chunks(stream: IO[bytes], size: int) -> Iterator[tuple[bytes, int]]:
    while stream.tell() < size:
        kind, length = _RECORD.unpack(stream.read(_RECORD.size))
        end = stream.tell() + length
        if end > size:
            return
        if kind == _CHUNK_KIND:
            (name,) = _CHUNK.unpack(stream.read(_CHUNK.size))
            yield stream.read(min(name, _MAX_NAME)), length
        stream.seek(end)


def _ros1_chunks(stream: IO[bytes], size: int) -> Iterator[tuple[bytes, int]]:
    stream.seek(0)
    if stream.read(len(_ROS1)) != _ROS1:
        return
    while stream.tell() < size:
        (length,) = _LENGTH.unpack(stream.read(_LENGTH.size))
        header = stream.read(length) if length <= _MAX_HEADER else b""
        stream.seek(length - len(header), SEEK_CUR)
        (data,) = _LENGTH.unpack(stream.read(_LENGTH.size))
        end = stream.tell() + data
        if end > size:
            return
        for field in _fields(header):
            if field.startswith(_NAME):
                yield field.removeprefix(_NAME), data
        stream.seek(end)


def _fields(header: bytes) -> Iterator[bytes]:
    at = 0
    while at < len(header):
        (length,) = _LENGTH.unpack_from(header, at)
        at += _LENGTH.size + length
        yield header[at - length : at]

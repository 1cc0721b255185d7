"""Windows of a recording, which is read from its first byte to its last, as a file or a pipe."""

from __future__ import annotations

import os
import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

import numpy as np

from pointkit.coding.byte_io import base_128
from pointkit.errors import InputError
from pointkit.files import open_file
from puck.chunks import MAGICS, ChunkOpener
from puck.gaps import Bytes, compress_bytes
from puck.records import Readable, Record, RecordKind, read_up_to
from puck.sqlite_pages import LINK_BYTES, MAGIC, encode_links, page_size
from puck.sqlite_payloads import (
    PageOrder,
    PageReader,
    encode_payloads,
    find_payloads,
    most_parts,
    state_of,
)

_START_BYTES = 18
"""Number of a file's first bytes that show what it is."""
_PAGES_AT_ONCE = 256


class _Checked:
    """Stream that counts the bytes read from it, and computes their CRC-32."""

    def __init__(self, stream: Readable, start: bytes = b"") -> None:
        self._stream, self._start = stream, start
        self.count, self.checksum = 0, 0

    def read(self, size: int) -> bytes:
        part, self._start = self._start[:size], self._start[size:]
        part = part or self._stream.read(size)
        self.count, self.checksum = self.count + len(part), zlib.crc32(part, self.checksum)
        return part


class Windows:
    """Reader of a recording's content, which differs from its bytes for some files.

    In the content of an SQLite file, pages have no links, and the bytes of long rows are
    contiguous. In the content of a bag, chunks are decompressed where this can be undone.

    Parameters
    ----------
    stream
        The recording from its first byte on. If it has pages, all of it was already read.
    content
        The content, if it differs from the bytes of `stream`.
    header
        Records that a decoder needs before the content.
    size
        Number of bytes of the recording or of the content, or None if it is not known before the
        end.

    Attributes
    ----------
    header
        As the parameter.
    """

    def __init__(
        self,
        stream: _Checked,
        content: ChunkOpener | PageReader | None = None,
        header: tuple[Record, ...] = (),
        size: int | None = None,
    ) -> None:
        self._stream, self._source = stream, content or stream
        self._chunks = content if isinstance(content, ChunkOpener) else None
        self.header, self.size = header, size
        self._content: Bytes = np.zeros(0, np.uint8)
        self._count = 0

    @property
    def read(self) -> int:
        """Number of bytes of the recording that were read so far."""
        return self._stream.count

    @property
    def checksum(self) -> int:
        """CRC-32 of the bytes of the recording that were read so far."""
        return self._stream.checksum

    @property
    def opened(self) -> int:
        """Number of compressed chunks that were opened so far."""
        return self._chunks.opened if self._chunks else 0

    @property
    def kept(self) -> int:
        """Number of compressed chunks that were not opened so far."""
        return self._chunks.kept if self._chunks else 0

    def next(self, size: int) -> tuple[Bytes, bool]:
        """Return the content that was not skipped yet, without skipping it.

        Returns
        -------
        content
            The next `size` bytes, or fewer at the end of the recording.
        is_last
            Whether the recording ends with these bytes.
        """
        missing = size + 1 - len(self._content)
        if missing > 0:
            part = np.frombuffer(read_up_to(self._source, missing), np.uint8)
            self._count += len(part)
            self._content = np.concatenate([self._content, part])
        return self._content[:size], len(self._content) <= size

    def take_records(self) -> list[Record]:
        """Return the records that a decoder needs before the content since the last call."""
        return self._chunks.take_records() if self._chunks else []

    def skip(self, size: int) -> None:
        """Go on after the next `size` bytes of content."""
        self._content = self._content[size:]

    def progress(self, done: int) -> tuple[int, int]:
        """Return how many bytes of how many the first `done` bytes of the content are."""
        if self._chunks:
            done = done * self.read // self._count
        return done, self.size or 0


@contextmanager
def windows_of(recording: Path | IO[bytes]) -> Iterator[Windows]:
    """Open a recording.

    Parameters
    ----------
    recording
        Path of a file, or a binary stream, such as a pipe. An SQLite file that comes from a stream
        is copied to a temporary file, because the links of its pages are compressed first.

    Raises
    ------
    InputError
        The file cannot be read, or the stream is empty.
    """
    if isinstance(recording, Path):
        if recording.is_dir():
            raise InputError(f"{recording}: a folder; compress the files in it")
        with open_file(recording) as file:
            yield _windows_of_file(file)
        return
    start = read_up_to(recording, _START_BYTES)
    if not start:
        raise InputError("there is nothing to compress: the input is empty")
    if not start.startswith(MAGIC):
        yield _windows_of_stream(recording, start)
        return
    with TemporaryFile() as copy:
        copy.write(start)
        shutil.copyfileobj(recording, copy)
        yield _windows_of_file(copy)


def _windows_of_stream(stream: IO[bytes], start: bytes, size: int | None = None) -> Windows:
    checked = _Checked(stream, start)
    for magic in MAGICS:
        if start.startswith(magic):
            return Windows(checked, ChunkOpener(checked, read_up_to(checked, len(magic))), (), size)
    return Windows(checked, size=size)


def _windows_of_file(file: IO[bytes]) -> Windows:
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    start = read_up_to(file, _START_BYTES)
    page = page_size(start, size)
    if not page:
        return _windows_of_stream(file, start, size)
    checked, parts_of_links, payloads, state = _Checked(file, start), [], [], state_of(file)
    count = 0
    while content := read_up_to(checked, _PAGES_AT_ONCE * page):
        pages = np.frombuffer(content, np.uint8, len(content) // page * page).reshape(-1, page)
        parts_of_links.append(pages[:, :LINK_BYTES].copy())
        payloads += find_payloads(pages, count)
        count += len(pages)
    links = np.concatenate(parts_of_links)
    order = PageOrder(page, links)
    payloads = order.usable(payloads)
    body = base_128(page) + compress_bytes(encode_links(links), are_headers=True)
    header = [Record(RecordKind.PAGES, body)]
    parts = order.parts([], 0)
    if payloads:
        body = encode_payloads(payloads)
        # What looks like rows in damaged pages gives no parts.
        with suppress(InputError):
            parts = order.parts(payloads, most_parts(body))
            header.append(Record(RecordKind.PAYLOADS, body))
    content_size = size // page * (page - LINK_BYTES)
    return Windows(checked, PageReader(file, page, parts, state), tuple(header), content_size)

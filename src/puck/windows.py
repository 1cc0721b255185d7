"""Windows of a recording, which is read from its first byte to its last, as a file or a pipe."""

from __future__ import annotations

import os
import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

import numpy as np

from pointkit.errors import InputError
from pointkit.files import open_file
from puck.gaps import Bytes
from puck.records import read_up_to
from puck.sqlite_pages import LINK_BYTES, MAGIC, page_size, read_links


class Windows:
    """Reader of a recording's content, i.e. of its bytes without the links of SQLite pages.

    Parameters
    ----------
    stream
        The recording, which must be seekable if it has pages.
    start
        Bytes of the recording that were already read from the stream.
    page
        Size of the pages of an SQLite file in bytes, or 0 for other recordings.
    size
        Size of the recording in bytes, or None if it is not known before the end.

    Attributes
    ----------
    read, checksum
        Number and CRC-32 of the bytes that were read so far, with links.
    page, size
        As the parameters.
    """

    def __init__(
        self, stream: IO[bytes], start: bytes = b"", page: int = 0, size: int | None = None
    ) -> None:
        self._stream = stream
        self.page, self.size = page, size
        self._content: Bytes = np.frombuffer(start, np.uint8)
        self.read, self.checksum = len(start), zlib.crc32(start)

    def links(self) -> Bytes:
        """Return the links (n, 4) of all pages, and go back to the beginning of the file."""
        links = read_links(self._stream, self.page)
        self._stream.seek(0)
        return links

    def next(self, size: int) -> tuple[Bytes, bool]:
        """Return the content that was not skipped yet, without skipping it.

        Returns
        -------
        content
            The next `size` bytes, or fewer at the end of the recording.
        is_last
            Whether the recording ends with these bytes.
        """
        self._read_ahead(size + 1)
        return self._content[:size], len(self._content) <= size

    def skip(self, size: int) -> None:
        """Go on after the next `size` bytes of content."""
        self._content = self._content[size:]

    def _read_ahead(self, size: int) -> None:
        missing = size - len(self._content)
        if missing <= 0:
            return
        pages = -(-missing // (self.page - LINK_BYTES)) if self.page else 0
        raw = read_up_to(self._stream, pages * self.page or missing)
        self.read, self.checksum = self.read + len(raw), zlib.crc32(raw, self.checksum)
        part = np.frombuffer(raw, np.uint8)
        if self.page:
            if len(raw) % self.page or self.read > (self.size or 0):
                raise InputError(f"{self._stream.name}: changes while it is read")
            part = part.reshape(-1, self.page)[:, LINK_BYTES:].ravel()
        self._content = np.concatenate([self._content, part])


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
    start = read_up_to(recording, len(MAGIC))
    if not start:
        raise InputError("there is nothing to compress: the input is empty")
    if start != MAGIC:
        yield Windows(recording, start)
        return
    with TemporaryFile() as copy:
        copy.write(start)
        shutil.copyfileobj(recording, copy)
        yield _windows_of_file(copy)


def _windows_of_file(file: IO[bytes]) -> Windows:
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    page = page_size(read_up_to(file, len(MAGIC) + 2), size)
    file.seek(0)
    return Windows(file, page=page, size=size)

"""Reading of files that may be compressed; the suffix of a file says how."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import sys
import tempfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from pointkit.errors import InputError
from pointkit.files import open_file, read_bytes, refuse_pointer, unreadable

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

_OPENERS: dict[str, Callable[[Path], Any]] = {
    ".gz": gzip.open,
    ".bz2": bz2.open,
    ".xz": lzma.open,
    ".zst": zstd.open,
}
COMPRESSED = tuple(_OPENERS)
"""Suffixes of compressed files."""
LEAST_LIMIT = 1 << 28
MOST_TIMES = 40
"""Limit of decompressed content: the larger of 256 MiB and 40 times the file's size."""
_PORTION, _HEAD = 1 << 20, 1 << 10


def plain_suffix(path: Path) -> str:
    """Return the suffix that names a file's format, in lowercase: ``.ply`` for ``a.PLY.gz``."""
    return plain_name(path).suffix.lower()


def plain_name(path: Path) -> Path:
    """Return a path without a suffix of compression: ``a.ply`` for ``a.ply.gz``."""
    return path.with_suffix("") if path.suffix.lower() in COMPRESSED else path


def limit_of(path: Path) -> int:
    """Return the largest number of bytes that a file's content may have after decompression."""
    return max(LEAST_LIMIT, MOST_TIMES * path.stat().st_size)


def read_content(path: Path, most: int | None = None) -> bytes:
    """Return the content of a file, decompressed if its suffix is in `COMPRESSED`.

    Parameters
    ----------
    path
        The file.
    most
        Number of bytes to read from the beginning of the content; by default, the whole content is
        read.

    Raises
    ------
    InputError
        The file is missing, unreadable or damaged, or the whole content exceeds `limit_of`.
    """
    if most is None and path.suffix.lower() not in COMPRESSED:
        return read_bytes(path)
    content = io.BytesIO()
    with _reading(path) as stream:
        left = limit_of(path) + 1 if most is None else most
        while left and (portion := stream.read(min(left, _PORTION))):
            content.write(portion)
            left -= len(portion)
    if most is None and not left:
        raise InputError(f"{path}: unpacks to more than {limit_of(path):,} bytes")
    return content.getvalue()


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """Provide an uncompressed file inside a `with` block, for readers that take a path.

    The context manager yields `path` itself if the file is not compressed. Otherwise it yields the
    path of a decompressed copy, which is deleted after the block. An InputError that is raised in
    the block names the original file.
    """
    if path.suffix.lower() not in COMPRESSED:
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder, plain_name(path).name)
        plain.write_bytes(read_content(path))
        try:
            yield plain
        except InputError as error:
            raise InputError(str(error).replace(str(plain), str(path))) from error


@contextmanager
def _reading(path: Path) -> Iterator[BinaryIO]:
    opener = _OPENERS.get(path.suffix.lower(), partial(Path.open, mode="rb"))
    try:
        with open_file(path) as stream:
            refuse_pointer(path, stream.read(_HEAD))
        with opener(path) as stream:
            yield stream
    except (EOFError, zlib.error, lzma.LZMAError, zstd.ZstdError) as error:
        raise InputError(f"{path}: damaged compressed file ({error})") from error
    except OSError as error:
        raise unreadable(path, error, f"damaged compressed file ({error})") from error

"""Writing of files that appear whole or not at all, and reading with errors that name the file."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import platform
import re
import shutil
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex
from typing import Any, BinaryIO

from pointkit.errors import InputError

_TEMPORARY = re.compile(r"^\..*\.(?P<host>[^.]*)-(?P<process>\d+)-[0-9a-f]{8}\.tmp(\.|$)")
_POINTER = b"version https://git-lfs.github.com/spec/"
_DAY = 24 * 3600.0
_SPECIAL = {
    stat.S_ISFIFO: "a pipe",
    stat.S_ISSOCK: "a socket",
    stat.S_ISCHR: "a device",
    stat.S_ISBLK: "a device",
}
_MOST_LEVELS = 100
"""Maximum nesting depth of a JSON file; puckbench's files have fewer than ten levels."""


@contextmanager
def written_whole(path: str | Path) -> Iterator[Path]:
    """Write a file so that it appears only when it is complete.

    The context manager yields a temporary path to write to. The temporary file is renamed to `path`
    if the `with` block succeeds, and removed after an exception. If several processes write the
    same path, the last one wins. Missing folders are created. The temporary name has the same
    suffix, since some writers choose the format by it.

    Raises
    ------
    InputError
        The system refuses to write (no permission, disk full).
    """
    path = Path(path)
    temporary = _temporary(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        if not _is_of(error, temporary, path):
            raise
        raise unwritable(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def folder_written_whole(path: str | Path) -> Iterator[Path]:
    """Write a folder so that it appears only when it is complete.

    The context manager yields a temporary folder beside `path`. It is renamed to `path` if the
    `with` block succeeds, and removed after an exception.

    Raises
    ------
    InputError
        `path` exists and is not an empty folder, or the system refuses to write.
    """
    path = Path(path)
    if path.exists() and not (path.is_dir() and not any(path.iterdir())):
        raise InputError(f"{path}: exists already, and is not an empty folder")
    place = path.resolve()
    temporary = _temporary(place)
    try:
        temporary.mkdir(parents=True)
        yield temporary
        os.replace(temporary, place)
    except OSError as error:
        if not _is_of(error, temporary, place):
            raise
        raise unwritable(path, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _temporary(path: Path) -> Path:
    # With the host, since processes of two machines may have the same number.
    writer = f"{_host()}-{os.getpid()}-{token_hex(4)}"
    return path.with_name(f".{path.stem}.{writer}.tmp{path.suffix}")


def _host() -> str:
    return platform.node().partition(".")[0]


def _is_of(error: OSError, *paths: Path) -> bool:
    if not isinstance(error.filename, str):
        return True
    named = Path(error.filename)
    return any(named == path or named in path.parents for path in paths)


def remove_leftovers(folder: Path) -> int:
    """Remove temporary files of interrupted writers from a folder and its subfolders.

    Returns the number of removed files.
    """
    hidden = [
        Path(place, name)
        for place, _, names in os.walk(folder)
        for name in names
        if name.startswith(".")
    ]
    leftovers = [path for path in hidden if _is_leftover(path)]
    for path in leftovers:
        path.unlink(missing_ok=True)
    return len(leftovers)


def _is_leftover(path: Path) -> bool:
    writer = _TEMPORARY.match(path.name)
    if writer is None:
        return False
    if writer["host"] == _host():
        return not Path("/proc", writer["process"]).exists() and Path("/proc/self").exists()
    with suppress(OSError):
        return time.time() - path.stat().st_mtime > _DAY
    return False


def text_end(path: Path, most_bytes: int) -> str:
    """Return the end of a text file, at most `most_bytes`, without trailing white space."""
    with path.open("rb") as stream:
        stream.seek(0, os.SEEK_END)
        stream.seek(max(0, stream.tell() - most_bytes))
        return stream.read().decode(errors="replace").rstrip()


def write_bytes(path: str | Path, data: bytes) -> None:
    with written_whole(path) as temporary:
        temporary.write_bytes(data)


def write_json(path: Path, value: Any) -> None:
    """Write indented JSON with sorted keys; raise ValueError for nan and infinity."""
    write_bytes(path, json_bytes(value))


def json_bytes(value: Any) -> bytes:
    """Return a value as indented JSON with sorted keys; raise ValueError for nan and infinity."""
    text = json.dumps(value, indent=1, sort_keys=True, allow_nan=False)
    return (text + "\n").encode()


def read_json(path: Path) -> Any:
    """Read a JSON file; raise InputError if it is missing, invalid, too deep, or repeats a key."""
    return json_of(read_bytes(path), str(path))


def json_of(data: bytes, what: str) -> Any:
    """Parse JSON as `read_json` does; messages of errors begin with `what`."""
    try:
        value = json.loads(data, object_pairs_hook=unique_keys)
        deep = _is_deep(value)
    except RecursionError:
        deep = True
    except ValueError as error:
        raise InputError(f"{what}: not valid JSON ({error})") from error
    if deep:
        raise InputError(f"{what}: JSON nested more than {_MOST_LEVELS} levels deep")
    return value


def _is_deep(value: Any) -> bool:
    level = [value] if isinstance(value, (dict, list)) else []
    for _ in range(_MOST_LEVELS):
        if not level:
            break
        inner = [each.values() if isinstance(each, dict) else each for each in level]
        level = [each for part in inner for each in part if isinstance(each, (dict, list))]
    return bool(level)


def read_object(path: Path) -> dict[str, Any]:
    """Read a JSON object from a file as a dictionary; raise InputError as `read_json` does."""
    return object_of(read_bytes(path), str(path))


def object_of(data: bytes, what: str) -> dict[str, Any]:
    """Parse a JSON object to a dictionary; raise InputError for other data.

    Messages of errors begin with `what`.
    """
    value = json_of(data, what)
    if not isinstance(value, dict):
        raise InputError(f"{what}: not a JSON object")
    return value


def unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a dictionary of a JSON object's pairs; raise ValueError if a key is repeated."""
    values: dict[str, Any] = {}
    for name, value in pairs:
        if name in values:
            raise ValueError(f"the key {name!r} is repeated")
        values[name] = value
    return values


def read_bytes(path: Path) -> bytes:
    """Return the content of a file; raise InputError if it cannot be read."""
    try:
        with open_file(path) as stream:
            data = stream.read()
    except OSError as error:
        raise unreadable(path, error) from error
    refuse_pointer(path, data)
    return data


def open_file(path: Path) -> BinaryIO:
    """Open a file for reading; raise InputError if that fails or the path is a pipe or device."""
    refuse_special(path)
    try:
        return path.open("rb")
    except OSError as error:
        raise unreadable(path, error) from error


def refuse_special(path: Path) -> None:
    """Raise InputError for a pipe, socket or device, since reading it may never end."""
    if kind := special_kind(path):
        raise InputError(f"{path}: {kind}, not a file")


def special_kind(path: Path) -> str | None:
    """Return ``a pipe``, ``a socket`` or ``a device``, or None for other paths."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return None
    return next((kind for is_kind, kind in _SPECIAL.items() if is_kind(mode)), None)


def refuse_pointer(path: Path, data: bytes) -> None:
    """Raise InputError if a file's content is only a pointer of Git LFS to the real file."""
    if data.startswith(_POINTER):
        raise InputError(f"{path}: a Git-LFS pointer, not the file itself: git lfs pull")


def unreadable(path: Path, error: OSError, otherwise: str = "unreadable") -> InputError:
    """Return an InputError with the reason why a file cannot be read."""
    if error.strerror is None and not path.exists():
        otherwise = os.strerror(errno.ENOENT)
    return InputError(f"{path}: {(error.strerror or otherwise).lower()}")


def unwritable(path: Path, error: OSError) -> InputError:
    # On a full disk some writers report only that fewer bytes were written.
    """Return an InputError with the reason why a file cannot be written."""
    why = os.strerror(error.errno) if error.errno else "not all of it was written; is the disk full"
    return InputError(f"{path}: {why.lower()}")


@contextmanager
def refusing_paths() -> Iterator[None]:
    """Convert an OSError that names a file, such as a too long name, to InputError."""
    try:
        yield
    except OSError as error:
        if not isinstance(error.filename, str):
            raise
        raise unreadable(Path(error.filename), error) from error


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal; raise InputError if it cannot be read."""
    return hashlib.sha256(read_bytes(path)).hexdigest()

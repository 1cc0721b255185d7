"""Digests of input files, by which jobs notice changed content even if the time is unchanged."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from stat import S_ISREG

from pointkit.errors import InputError
from pointkit.models import Model, parsed
from pointkit.terminal import Progress
from puckbench.planning.memory import Memory

_MOST_READ = 1 << 30
"""Size up to which a file is read whole, bytes; this takes 0.8 s (1.3 GB/s)."""
_PARTS, _PART = 64, 1 << 16
"""Number and size (bytes) of the parts of a larger file that are read."""
_INPUTS = ".digests.json"
_State = tuple[int, ...]


class _Remembered(Model):
    state: _State
    digest: str


def file_digests(paths: Iterable[Path], memory: Memory, name: str = _INPUTS) -> dict[Path, str]:
    """Return a digest of the content of each file or folder, as text by path.

    For a file over 1 GiB, the digest covers only the size, the time of modification and 64 evenly
    spaced parts.

    Parameters
    ----------
    paths
        Files, and folders of which all files count.
    memory
        Stores the digests between runs. A file is read again if its size, times or inode changed.
    name
        Name of the file in which they are stored.
    """
    files = {path: list(_files(path)) for path in dict.fromkeys(paths)}
    states = {file: _state(file) for inner in files.values() for file in inner}
    known = _read(memory, name) if states else {}
    new = [file for file, state in states.items() if _is_new(known.get(str(file)), state)]
    progress, done = Progress("MiB of input files read:"), 0
    total = sum(_size(states[file]) for file in new) >> 20
    for file in new:
        known[str(file)] = _Remembered(state=states[file], digest=_digest(file, states[file]))
        done += _size(states[file])
        if total > _MOST_READ >> 20:
            progress(done >> 20, total)
    if new:
        memory.learn(name, {file: entry.model_dump() for file, entry in known.items()})
    return {path: _joined(path, inner, known) for path, inner in files.items()}


def _files(path: Path) -> Iterator[Path]:
    yield from sorted(path.rglob("*")) if path.is_dir() else [path]


def _state(file: Path) -> _State:
    """Return size, times and inode of a file, or an empty tuple if it is no regular file."""
    with suppress(OSError):
        stat = file.stat()
        if S_ISREG(stat.st_mode):
            return stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino
    return ()


def _size(state: _State) -> int:
    return min(state[0], _MOST_READ) if state else 0


def _read(memory: Memory, name: str) -> dict[str, _Remembered]:
    with suppress(InputError):  # of another version
        entries = memory.read(name)
        return {file: parsed(_Remembered, entry, file) for file, entry in entries.items()}
    return {}


def _is_new(known: _Remembered | None, state: _State) -> bool:
    return bool(state) and (known is None or known.state != state)


def _digest(file: Path, state: _State) -> str:
    size, modified_ns, *_ = state
    with suppress(OSError), file.open("rb") as stream:
        if size <= _MOST_READ:
            return hashlib.file_digest(stream, "sha256").hexdigest()
        digest = hashlib.sha256(f"{size} {modified_ns}".encode())
        for part in range(_PARTS):
            stream.seek(part * (size - _PART) // (_PARTS - 1))
            digest.update(stream.read(_PART))
        return digest.hexdigest()
    return ""


def _joined(path: Path, files: Iterable[Path], known: Mapping[str, _Remembered]) -> str:
    lines = [
        f"{file.relative_to(path)} {known[str(file)].digest if str(file) in known else ''}"
        for file in files
    ]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()

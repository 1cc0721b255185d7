"""Parsers of other packages, in a process of their own with limits of memory and time.

A damaged file may make such a parser abort, or take all memory, and with it whoever called it. One
process parses file after file; after a crash, a limit or an interruption the next file gets
another. Arrays and JSON come back through a pipe, never pickled objects. Where the system has no
limit of address space (macOS), only the time is limited.
"""

from __future__ import annotations

import atexit
import json
import logging
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from io import BufferedReader
from pathlib import Path
from threading import Timer
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.core.files import unreadable

LEAST_BYTES, BYTES_PER_BYTE = 2 << 30, 40
"""Memory that parsing may take: the larger of this, and of so many bytes for each of the file."""
LEAST_SECONDS, SECONDS_PER_MB = 10, 1
"""Processor time that parsing may take."""
_PATIENCE = 20
"""Clock time to processor time, at most."""
_SIZES = Path("/proc/self/statm")
_ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}
"""Threads reserve address space that they do not use."""


@dataclass(frozen=True)
class Parsed:
    """Result of a parser: arrays (n,) or (n, k) by name, and values that JSON can hold."""

    columns: dict[str, NDArray[Any]]
    about: dict[str, Any] = field(default_factory=dict)


def isolated(
    parse: Callable[..., Parsed],
    path: Path,
    kind: str,
    options: Mapping[str, Any] | None = None,
    beside: Sequence[Path] = (),
) -> Parsed:
    """Run ``parse(path, **options)`` in a process of its own, within limits of the file's size.

    Parameters
    ----------
    parse
        A function of a module. Its remarks (warnings of ``puckbench`` loggers) are logged here.
    path
        The file, or a folder of files.
    kind
        What it should be, as messages name it: ``LAS file``.
    options
        Further arguments, in JSON's types.
    beside
        Files that belong to it, where they are there.

    Raises
    ------
    InputError
        That of `parse`; or the parser crashed, or wanted more memory or time than the file's size
        allows.
    """
    size = _size(path) + sum(file.stat().st_size for file in beside if file.is_file())
    memory, seconds = limits(size)
    request = {
        "function": (parse.__module__, parse.__name__),
        "folder": str(Path.cwd()),
        "path": str(path),
        "options": dict(options or {}),
        "limits": (memory, seconds),
    }
    answer, parsed = _answer(request, seconds)
    for name, level, line in answer.get("remarks", ()):
        logging.getLogger(name).log(level, "%s", line)
    if (fault := answer.get("fault")) is not None:
        words = {"memory": f"takes more than {memory / 2**30:.3g} GiB"}
        words["time"] = f"takes more than {seconds} s"
        raise InputError(f"{path}: not a readable {kind} (parsing it {words[fault]})")
    if (line := answer.get("error")) is not None:
        raise InputError(line)
    if parsed is None:
        raise InputError(f"{path}: not a readable {kind} (its parser crashes)")
    return parsed


def limits(size: int) -> tuple[int, int]:
    """Bytes of memory and seconds of processor time that parsing a file of `size` may take."""
    seconds = LEAST_SECONDS + SECONDS_PER_MB * (size // 10**6)
    return max(LEAST_BYTES, BYTES_PER_BYTE * size), seconds


def _size(path: Path) -> int:
    files = [path, *path.rglob("*")] if path.is_dir() else [path]
    try:
        return sum(file.stat().st_size for file in files)
    except OSError as error:
        raise unreadable(path, error) from error


# ---- the caller's side


class _Worker:
    """The process, and a request to it."""

    def __init__(self) -> None:
        paths = os.pathsep.join(path for path in sys.path if path)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **_ENVIRONMENT, "PYTHONPATH": paths},
        )
        self._requests = cast("IO[bytes]", self._process.stdin)
        self._answers = cast("BufferedReader", self._process.stdout)

    def ask(self, request: Mapping[str, Any], seconds: float) -> tuple[dict[str, Any], Any]:
        patience = Timer(_PATIENCE * seconds, self._process.kill)
        patience.daemon = True
        patience.start()
        try:
            self._requests.write(json.dumps(request).encode() + b"\n")
            self._requests.flush()
            return _received(self._answers)
        except (OSError, EOFError):
            code = self._process.wait()
            is_late = code == -signal.SIGXCPU or not patience.is_alive()
            return ({"fault": "time"} if is_late else {}), None
        finally:
            patience.cancel()

    def has_ended(self) -> bool:
        return self._process.poll() is not None

    def close(self) -> None:
        self._process.kill()
        self._process.communicate()


_workers: dict[int, _Worker] = {}
"""The process that waits for a file, by the number of its caller: forked ones need others."""


def _answer(request: Mapping[str, Any], seconds: float) -> tuple[dict[str, Any], Parsed | None]:
    worker = _workers.pop(os.getpid(), None)
    if worker is None or worker.has_ended():
        worker = _Worker()
    is_whole = False
    try:
        answer, parsed = worker.ask(request, seconds)
        is_whole = parsed is not None or "error" in answer
    finally:
        if not is_whole or _workers.setdefault(os.getpid(), worker) is not worker:
            worker.close()
    return answer, parsed


@atexit.register
def _close() -> None:
    worker = _workers.pop(os.getpid(), None)
    if worker is not None:
        worker.close()


def _received(stream: BufferedReader) -> tuple[dict[str, Any], Parsed | None]:
    line = stream.readline()
    if not line.endswith(b"\n"):
        raise EOFError
    answer: dict[str, Any] = json.loads(line)
    if "about" not in answer:
        return answer, None
    columns = {name: _array(stream, *kind) for name, *kind in answer["columns"]}
    return answer, Parsed(columns, answer["about"])


def _array(stream: BufferedReader, kind: str, shape: list[int]) -> NDArray[Any]:
    array = np.empty(shape, np.dtype(kind))
    place = array.reshape(-1).view(np.uint8).data
    while place:
        count = stream.readinto(place)
        if not count:
            raise EOFError
        place = place[count:]
    return array


# ---- the process's side


def serve() -> None:
    """Answer the requests on standard input until it ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # parsers may print
    remarks = _Remarks()
    logging.getLogger("puckbench").addHandler(remarks)
    for line in sys.stdin.buffer:
        request = json.loads(line)
        remarks.lines.clear()
        os.chdir(request["folder"])
        _limit(*request["limits"])
        answer, arrays = _parsed(request)
        answers.write(json.dumps({**answer, "remarks": remarks.lines}).encode() + b"\n")
        for array in arrays:
            answers.write(array.reshape(-1).view(np.uint8))  # type: ignore[arg-type]
        answers.flush()


def _parsed(request: Mapping[str, Any]) -> tuple[dict[str, Any], list[NDArray[Any]]]:
    module, name = request["function"]
    try:
        parsed = getattr(import_module(module), name)(Path(request["path"]), **request["options"])
        columns = {key: np.ascontiguousarray(part) for key, part in parsed.columns.items()}
    except InputError as error:
        return {"error": str(error)}, []
    except MemoryError:
        return {"fault": "memory"}, []
    kinds = [(key, part.dtype.str, part.shape) for key, part in columns.items()]
    return {"about": parsed.about, "columns": kinds}, list(columns.values())


def _limit(memory: int, seconds: int) -> None:
    """Limit what this process may take beyond what it has taken."""
    import resource

    _lower(resource.RLIMIT_CPU, math.ceil(time.process_time()) + seconds)
    if _SIZES.exists():
        pages = int(_SIZES.read_text().split()[0])
        _lower(resource.RLIMIT_AS, pages * resource.getpagesize() + memory)
    _lower(resource.RLIMIT_FSIZE, memory)


def _lower(what: int, limit: int) -> None:
    import resource

    _, most = resource.getrlimit(what)
    resource.setrlimit(what, (limit if most == resource.RLIM_INFINITY else min(limit, most), most))


class _Remarks(logging.Handler):
    """Keeps what is logged: logger, level and line."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[tuple[str, int, str]] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append((record.name, record.levelno, record.getMessage()))


if __name__ == "__main__":
    serve()

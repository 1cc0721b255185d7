"""A worker process, limited in memory and time, that runs parsers of other packages.

Some of these parsers end their process, or take all memory, when a file is damaged. The worker is
started for the first file, and is replaced after a crash or when its time is over. It sends back
arrays and JSON, never pickled objects. On macOS, only the time is limited.
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

from pointkit.errors import InputError
from pointkit.files import refuse_special, unreadable

MIN_BYTES, BYTES_PER_BYTE = 2 << 30, 40
"""Memory limit: the larger of 2 GiB and 40 times the file's size."""
MIN_SECONDS, SECONDS_PER_MB = 10, 1
"""Limit of processor time: 10 s plus 1 s per MB of the file."""
_CLOCK_FACTOR = 20
"""Ratio of the limit of elapsed time to that of processor time."""
_MEMORY_USE = Path("/proc/self/statm")
_ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}
"""Environment variables that reduce the address space which threads reserve."""


Columns = dict[str, NDArray[Any]]
"""Arrays by name."""


@dataclass(frozen=True)
class ParsedFile:
    """Result of a parser that runs in the worker process.

    Parameters
    ----------
    columns
        Arrays of any shape, by name.
    about
        Further values, which JSON can represent.
    """

    columns: Columns
    about: dict[str, Any] = field(default_factory=dict)


def parse_isolated(
    parse: Callable[..., ParsedFile],
    path: Path,
    kind: str,
    options: Mapping[str, Any] | None = None,
    side_files: Sequence[Path] = (),
) -> ParsedFile:
    """Run ``parse(path, **options)`` in the worker process, within the limits of `parser_limits`.

    Parameters
    ----------
    parse
        A function of a module that can be imported.
    path
        The file, or a folder of files.
    kind
        What the file is, for messages ("LAS file").
    options
        Keyword arguments of `parse`, which JSON can represent.
    side_files
        Further files that `parse` reads; the limits grow with their size, too.

    Returns
    -------
    ParsedFile
        What `parse` returned. Its warnings are logged by the calling process.

    Raises
    ------
    InputError
        `parse` raised InputError, ended its process, or exceeded a limit.
    """
    size = _size(path) + sum(file.stat().st_size for file in side_files if file.is_file())
    memory, seconds = parser_limits(size)
    request = {
        "function": (parse.__module__, parse.__name__),
        "folder": str(Path.cwd()),
        "path": str(path),
        "options": dict(options or {}),
        "limits": (memory, seconds),
    }
    answer, parsed = _ask_worker(request, seconds)
    for name, level, line in answer.get("warnings", ()):
        logging.getLogger(name).log(level, "%s", line)
    if (resource := answer.get("exceeded")) is not None:
        limit = f"{memory / 2**30:.3g} GiB" if resource == "memory" else f"{seconds} s"
        raise InputError(f"{path}: not a readable {kind} (parsing it takes more than {limit})")
    if (line := answer.get("error")) is not None:
        raise InputError(line)
    if parsed is None:
        raise InputError(f"{path}: not a readable {kind} (its parser crashes)")
    return parsed


def parser_limits(size: int) -> tuple[int, int]:
    """Return how much a parser may use for a file: memory in bytes, and processor time in seconds.

    Parameters
    ----------
    size
        Size of the file in bytes.
    """
    seconds = MIN_SECONDS + SECONDS_PER_MB * (size // 10**6)
    return max(MIN_BYTES, BYTES_PER_BYTE * size), seconds


def _size(path: Path) -> int:
    refuse_special(path)
    files = [path, *path.rglob("*")] if path.is_dir() else [path]
    try:
        return sum(file.stat().st_size for file in files)
    except OSError as error:
        raise unreadable(path, error) from error


# ---- in the calling process

_Answer = tuple[dict[str, Any], ParsedFile | None]


class _Worker:
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

    def ask(self, request: Mapping[str, Any], seconds: float) -> _Answer:
        timer = Timer(_CLOCK_FACTOR * seconds, self._process.kill)
        timer.daemon = True
        timer.start()
        try:
            self._requests.write(json.dumps(request).encode() + b"\n")
            self._requests.flush()
            return _receive(self._answers)
        except (OSError, EOFError):
            code = self._process.wait()
            is_late = code == -signal.SIGXCPU or not timer.is_alive()
            return ({"exceeded": "time"} if is_late else {}), None
        finally:
            timer.cancel()

    def has_ended(self) -> bool:
        return self._process.poll() is not None

    def close(self) -> None:
        self._process.kill()
        self._process.communicate()


_workers: dict[int, _Worker] = {}
"""Idle worker by the calling process's id; a forked process needs a new worker."""


def _ask_worker(request: Mapping[str, Any], seconds: float) -> _Answer:
    worker = _workers.pop(os.getpid(), None)
    if worker is None or worker.has_ended():
        worker = _Worker()
    is_complete = False
    try:
        answer, parsed = worker.ask(request, seconds)
        is_complete = parsed is not None or "error" in answer
    finally:
        if not is_complete or _workers.setdefault(os.getpid(), worker) is not worker:
            worker.close()
    return answer, parsed


@atexit.register
def _close() -> None:
    worker = _workers.pop(os.getpid(), None)
    if worker is not None:
        worker.close()


def _receive(stream: BufferedReader) -> _Answer:
    line = stream.readline()
    if not line.endswith(b"\n"):
        raise EOFError
    answer: dict[str, Any] = json.loads(line)
    if "about" not in answer:
        return answer, None
    columns = {name: _receive_array(stream, *kind) for name, *kind in answer["columns"]}
    return answer, ParsedFile(columns, answer["about"])


def _receive_array(stream: BufferedReader, kind: str, shape: list[int]) -> NDArray[Any]:
    array = np.empty(shape, np.dtype(kind))
    buffer = array.reshape(-1).view(np.uint8).data
    while buffer:
        count = stream.readinto(buffer)
        if not count:
            raise EOFError
        buffer = buffer[count:]
    return array


# ---- in the worker process


def serve() -> None:
    """Run the worker process: answer requests from standard input until it ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # parsers may print
    warnings = _WarningRecorder()
    logging.getLogger().addHandler(warnings)
    for line in sys.stdin.buffer:
        request = json.loads(line)
        warnings.lines.clear()
        os.chdir(request["folder"])
        _limit(*request["limits"])
        answer, arrays = _parse(request)
        answers.write(json.dumps({**answer, "warnings": warnings.lines}).encode() + b"\n")
        for array in arrays:
            answers.write(array.reshape(-1).view(np.uint8))  # type: ignore[arg-type]
        answers.flush()


def _parse(request: Mapping[str, Any]) -> tuple[dict[str, Any], list[NDArray[Any]]]:
    module, name = request["function"]
    try:
        parsed = getattr(import_module(module), name)(Path(request["path"]), **request["options"])
        columns = {key: np.ascontiguousarray(part) for key, part in parsed.columns.items()}
    except InputError as error:
        return {"error": str(error)}, []
    except MemoryError:
        return {"exceeded": "memory"}, []
    kinds = [(key, part.dtype.str, part.shape) for key, part in columns.items()]
    return {"about": parsed.about, "columns": kinds}, list(columns.values())


def _limit(memory: int, seconds: int) -> None:
    import resource

    _lower_limit(resource.RLIMIT_CPU, math.ceil(time.process_time()) + seconds)
    if _MEMORY_USE.exists():
        pages = int(_MEMORY_USE.read_text().split()[0])
        _lower_limit(resource.RLIMIT_AS, pages * resource.getpagesize() + memory)
    _lower_limit(resource.RLIMIT_FSIZE, memory)


def _lower_limit(kind: int, limit: int) -> None:
    import resource

    _, hard = resource.getrlimit(kind)
    resource.setrlimit(kind, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))


class _WarningRecorder(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[tuple[str, int, str]] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append((record.name, record.levelno, record.getMessage()))


if __name__ == "__main__":
    serve()

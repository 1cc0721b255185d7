"""A new process that decodes streams of a codec, and encodes the same clouds again.

Its working folder and its folder of temporary files are new and empty. So it shows a decoder that
needs more than the stream: what the encoder left in memory or in such a folder.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from subprocess import DEVNULL, PIPE, TimeoutExpired
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pointkit.errors import error_text
from pointkit.geometry.cloud import Floats
from pointkit.registry import is_place

if TYPE_CHECKING:
    from puckbench.checks.subject import Subject

RANDOM = "random points"
"""Name of the stream of random points among those by rate."""
_SECONDS = 60.0
_HASH_SEED = "4242"
"""Seed of Python's hashes, on which the order of sets depends."""


class Elsewhere(NamedTuple):
    """What a new process made of streams.

    Parameters
    ----------
    points
        Decoded points (m, 3) by name of the stream: a rate, or `RANDOM`.
    errors
        Errors by name of a stream that was not decoded.
    same_bytes
        Whether the cloud was coded to the same bytes, at the first and the last rate.
    read
        Files that the process opened while it decoded.
    ended
        How the process ended if it did not finish, else "".
    """

    points: Mapping[str, Floats] = {}
    errors: Mapping[str, str] = {}
    same_bytes: Mapping[str, bool] = {}
    read: frozenset[Path] = frozenset()
    ended: str = ""


def ask_elsewhere(subject: Subject) -> Elsewhere:
    """Start a new process that decodes the subject's streams, and return what it made of them."""
    streams = dict(subject.streams)
    if subject.random_stream is not None:
        streams[RANDOM] = subject.random_stream
    with TemporaryDirectory(prefix="puckbench-") as name:
        folder = Path(name)
        for part in ("streams", "work", "temporary"):
            (folder / part).mkdir()
        for number, stream in enumerate(streams.values()):
            (folder / "streams" / f"{number}.bin").write_bytes(stream)
        request = {
            "name": _absolute(subject.codec.name),
            "entry": {k: _absolute(value) for k, value in subject.entry.items()},
            "kind": subject.kind,
            "names": list(streams),
            "folder": str(folder / "streams"),
        }
        # Weights may be named by a path from the working folder.
        has_weights = any(map(subject.codec.weights, subject.rates))
        with subprocess.Popen(
            [sys.executable, "-P", "-c", _PROGRAM, json.dumps(request)],
            cwd=Path.cwd() if has_weights else folder / "work",
            env={
                **os.environ,
                "PYTHONPATH": python_path(),
                "PYTHONHASHSEED": _HASH_SEED,
                "TMPDIR": str(folder / "temporary"),
            },
            stdin=PIPE,  # by which it notices that this process has ended
            stdout=DEVNULL,
            stderr=DEVNULL,
        ) as process:
            try:
                process.wait(_SECONDS)
            except TimeoutExpired:
                process.kill()
                return Elsewhere(ended=f"it did not end within {_SECONDS:.0f} s")
        answer = folder / "streams" / "answer.json"
        if not answer.exists():
            return Elsewhere(ended=how_it_ended(process.returncode))
        told = json.loads(answer.read_text())
        arrays = {
            each: np.load(folder / "streams" / f"{number}.npy")
            for number, each in enumerate(streams)
            if each not in told["errors"]
        }
        read = frozenset(map(Path, told["read"]))
        return Elsewhere(arrays, told["errors"], told["same_bytes"], read)


def python_path() -> str:
    """Return a ``PYTHONPATH`` with which a new process imports what this one does."""
    return os.pathsep.join(path or str(Path.cwd()) for path in sys.path)


def how_it_ended(status: int | None) -> str:
    """Return how a process ended, given its exit status as Python's `subprocess` has it."""
    if status is not None and status < 0:
        return f"it was ended by signal {-status}"
    return f"it ended with exit status {status}"


def _absolute(value: Any) -> Any:
    """Return a place ``file.py:Name`` with an absolute path; other values are returned as is."""
    if not is_place(value):
        return value
    file, _, name = value.rpartition(":")
    return f"{Path(file).absolute()}:{name}" if file.endswith(".py") else value


# ---- in the new process

_PROGRAM = f"import sys; from {__name__} import serve; serve(sys.argv[1])"


def serve(request: str) -> None:
    """Decode streams and encode clouds as `ask_elsewhere` requests (JSON)."""
    from puckbench.checks.opened_files import recorded_files
    from puckbench.checks.subject import Subject
    from puckbench.core.interrupts import signal_end

    signal_end(0)
    asked = json.loads(request)
    folder = Path(asked["folder"])
    subject = Subject(opened(asked["name"], asked["entry"]), asked["kind"], asked["entry"])
    errors: dict[str, str] = {}
    with recorded_files() as read:
        for number, name in enumerate(asked["names"]):
            stream = (folder / f"{number}.bin").read_bytes()
            try:
                np.save(folder / f"{number}.npy", subject.decode(stream).xyz)
            except Exception as error:  # noqa: BLE001 (of a codec of the user)
                errors[name] = error_text(error).replace(f"codec {asked['name']}: ", "")
    same = {}
    for rate in () if errors else dict.fromkeys((subject.rates[0], subject.finest)):
        stream = (folder / f"{asked['names'].index(rate)}.bin").read_bytes()
        same[rate] = subject.encode(subject.cloud, rate) == stream
    answer = {"errors": errors, "same_bytes": same, "read": list(map(str, read))}
    (folder / "answer.json").write_text(json.dumps(answer))


def opened(name: str, entry: Mapping[str, Any]) -> Any:
    """Return a codec that the user named, ready to code.

    The arguments are those of `puckbench.codecs.registry.open_codec`. Raises InputError if there is
    no such codec, or it cannot run here.
    """
    from pointkit.registry import trust
    from puckbench.codecs.registry import open_codec
    from puckbench.steps.coding import codec_plugins, ready

    trust(codec_plugins(name, entry))
    return ready(open_codec(name, entry))

"""Runs the checks on a codec in a process of its own, and says what happened to it.

The process loads the codec's code, which may end it, hang, or start other processes. It is the
leader of a session, with which all of them end.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from multiprocessing import Pipe
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self, cast

from pointkit.errors import InputError, error_text
from puckbench.checks.elsewhere import how_it_ended, python_path
from puckbench.checks.registry import Advice, Check, Fault, Finding, LeftOut, Outcome, checks

_OPENING_SECONDS = 240.0
"""Time limit for loading a codec, which may compile loops for two minutes, once."""
_ENDING_SECONDS = 5.0
_TO_DO = "raise InputError instead of ending the process; if it is slow, check on an idle machine"
_OPENING = Check("loading", lambda subject: "", 0, "mend the class or its file")


def check_codec(name: str, entry: Mapping[str, Any]) -> Iterator[Finding]:
    """Run all checks on a codec, and yield what each found as soon as it has ended.

    Parameters
    ----------
    name
        Name of the codec, ``module:Class`` or ``path/to/file.py:Class``.
    entry
        What a configuration says about the codec (`puckbench.codecs.registry.Entry`).

    Raises
    ------
    InputError
        There is no such codec, or it cannot run here.
    """
    with _Worker(name, entry) as worker:
        kinds = worker.open()
        if isinstance(kinds, Finding):
            yield kinds
            return
        first, *others = checks()
        for kind in kinds:
            basic = worker.ask(first, kind)
            yield basic
            if basic.outcome == "failed":
                why = f"needs what failed: {first.title}"
                yield from (Finding(each.title, kind, "left out", why) for each in others)
                continue
            yield from (worker.ask(each, kind) for each in others)


class _Worker:
    """The process that runs checks; it is started again after it has ended."""

    def __init__(self, name: str, entry: Mapping[str, Any]) -> None:
        self._request = json.dumps({"name": name, "entry": dict(entry)})
        self._folder = TemporaryDirectory(prefix="puckbench-")
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.leave()
        self._folder.cleanup()

    def open(self) -> list[str] | Finding:
        """Start the process, and return the kinds of clouds that the codec codes.

        If loading the codec ends the process, this is returned. Raises InputError if the codec
        cannot be loaded.
        """
        self._connection, theirs = Pipe()
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _PROGRAM, str(theirs.fileno()), self._request],
            pass_fds=[theirs.fileno()],
            env={
                **os.environ,
                "PYTHONPATH": python_path(),
                "TMPDIR": self._folder.name,
            },
            stdin=subprocess.PIPE,  # by which it notices that this process has ended
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        theirs.close()
        answer = self._answer(_OPENING_SECONDS)
        if isinstance(answer, str):
            return _ended(_OPENING, "", answer, _OPENING.advice)
        if "error" in answer:
            raise InputError(answer["error"])
        if "fault" in answer:
            return Finding(_OPENING.title, "", "failed", f"{answer['fault']}: {_OPENING.advice}")
        for line in answer["notes"]:
            sys.stderr.write(line + "\n")
        return cast("list[str]", answer["kinds"])

    def ask(self, check: Check, kind: str) -> Finding:
        """Run a check with clouds of a kind, and return what it found."""
        start = time.perf_counter()
        if self._process is None and isinstance(again := self.open(), Finding):
            return again
        with suppress(OSError):
            self._connection.send_bytes(json.dumps([check.name, kind]).encode())
        answer = self._answer(check.seconds)
        seconds = time.perf_counter() - start
        if isinstance(answer, str):
            return _ended(check, kind, answer, _TO_DO)
        return Finding(
            check.title, kind, cast("Outcome", answer["outcome"]), answer["line"], seconds
        )

    def _answer(self, seconds: float) -> dict[str, Any] | str:
        """Return the process's answer, or how it ended; if it is late, it is ended here."""
        process = cast("subprocess.Popen[bytes]", self._process)
        try:
            if self._connection.poll(seconds):
                return cast("dict[str, Any]", json.loads(self._connection.recv_bytes()))
        except (EOFError, OSError):
            with suppress(subprocess.TimeoutExpired):
                process.wait(_ENDING_SECONDS)
        is_late = process.poll() is None
        self.leave()
        if is_late:
            return f"it did not end within {seconds:.0f} s"
        return how_it_ended(process.returncode)

    def leave(self) -> None:
        """End the process, and those that it started."""
        process, self._process = self._process, None
        if process is not None:
            self._connection.close()
            with suppress(ProcessLookupError), process:
                os.killpg(process.pid, signal.SIGKILL)


def _ended(check: Check, kind: str, how: str, to_do: str) -> Finding:
    line = f"the codec's process is gone: {how}: {to_do}"
    return Finding(check.title, kind, "failed", line)


# ---- in the process that runs checks

_PROGRAM = f"import sys; from {__name__} import serve; serve(*sys.argv[1:])"


def serve(descriptor: str, request: str) -> None:
    """Run the checks that another process requests, until it closes the connection.

    Parameters
    ----------
    descriptor
        File descriptor of the connection, as text. It carries JSON: a request is the name of a
        check and a kind of clouds, and the answer is what the check found.
    request
        The codec to check: JSON with its ``name`` and ``entry`` (`check_codec`).
    """
    from contextlib import redirect_stderr
    from io import StringIO
    from multiprocessing.connection import Connection

    from puckbench.checks.elsewhere import opened
    from puckbench.checks.subject import Subject, kinds_of
    from puckbench.core.interrupts import signal_end

    signal_end(0)
    connection = Connection(int(descriptor))
    asked, notes = json.loads(request), StringIO()
    try:
        with redirect_stderr(notes):
            codec = opened(asked["name"], asked["entry"])
            kinds = kinds_of(codec)
            if not kinds:
                raise InputError(f"codec {codec.name}: skips every cloud at every rate")
        subjects = {kind: Subject(codec, kind, asked["entry"]) for kind in kinds}
        told = [line for line in notes.getvalue().splitlines() if line.startswith("puckbench: ")]
        answer: dict[str, Any] = {"kinds": kinds, "notes": told}
    except InputError as error:
        answer = {"error": str(error)}
    except Exception as error:  # noqa: BLE001 (of a codec of the user)
        answer = {"fault": error_text(error)}
    connection.send_bytes(json.dumps(answer).encode())
    folder, by_name = Path.cwd(), {check.name: check for check in checks()}
    with suppress(EOFError):
        while True:
            name, kind = json.loads(connection.recv_bytes())
            outcome, line = run_check(by_name[name], subjects[kind])
            os.chdir(folder)  # which the codec may have left
            connection.send_bytes(json.dumps({"outcome": outcome, "line": line}).encode())


def run_check(check: Check, subject: Any) -> tuple[Outcome, str]:
    """Run a check in this process, and return how it ended and the line on what it found."""
    try:
        return "passed", check.call(subject)
    except LeftOut as why:
        return "left out", str(why)
    except Advice as advice:
        return "advice", str(advice)
    except Fault as fault:
        return "failed", str(fault)
    except Exception as error:  # noqa: BLE001 (of a codec of the user)
        text = str(error) if isinstance(error, InputError) else error_text(error)
        notes = "".join(f"{note}: " for note in getattr(error, "__notes__", ()))
        named = text.replace(f"codec {subject.codec.name}: ", "")
        line = named if named.startswith(notes) else notes + named
        return "failed", f"{line}: {check.advice}"

"""The process that runs one step, and prints its time and memory in the last line."""

from __future__ import annotations

import faulthandler
import gc
import os
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from inspect import signature
from io import UnsupportedOperation
from pathlib import Path
from typing import Any, NoReturn

from pointkit.errors import InputError, error_text
from pointkit.files import json_of, read_json
from puckbench.core.children import adopt_orphans, end_children
from puckbench.steps.cost import cost_line
from puckbench.steps.step import STEPS, Step

TIMEOUT = "PUCKBENCH_TIMEOUT_S"
"""Environment variable with the time limit of a step in s; empty or 0 means no limit."""
_KEY = "--key="
_OBJECTS_PER_SEARCH = 10_000
"""Number of new objects after which Python looks for garbage.

It is higher than usual, since imports make many objects that are never garbage.
"""


def main(words: Sequence[str], *, is_alone: bool = False) -> int:
    """Run a step, print a line about a failure to standard error, and return the exit status.

    Parameters
    ----------
    words
        The step's name; its settings as JSON, or ``@FILE`` with a file that has them; and the
        paths of input and output files as ``key=FILE``. Words without a key are further files of
        the last key. ``--key=TEXT`` gives a text for the last line of the log, which identifies
        settings and code.
    is_alone
        Whether this process runs this step only. If so, it kills the child processes that are left
        when the step has ended.
    """
    if is_alone:
        adopt_orphans()
    gc.set_threshold(_OBJECTS_PER_SEARCH)
    with suppress(UnsupportedOperation):  # standard error may not be a file
        faulthandler.enable()
    if limit_s := float(os.environ.get(TIMEOUT) or 0):
        faulthandler.dump_traceback_later(limit_s, exit=True)
    folder = f"{Path.cwd()}{os.sep}"
    try:
        _run(words, is_alone)
    except InputError as error:
        text = ": ".join([*getattr(error, "__notes__", ()), *str(error).splitlines()])
        if not any(folder in word for word in words):  # paths are told as they were given
            text = text.replace(folder, "")
        print(f"puckbench: {' '.join(text.split())}", file=sys.stderr)  # noqa: T201
        return 2
    except KeyboardInterrupt:
        print("puckbench: interrupted", file=sys.stderr)  # noqa: T201
        return 130
    except BaseException as error:  # noqa: BLE001 (of a user's plug-in, which may call sys.exit)
        traceback.print_exc()
        print(f"puckbench: {error_text(error)}", file=sys.stderr)  # noqa: T201
        return 1
    finally:
        faulthandler.cancel_dump_traceback_later()
    return 0


def _run(words: Sequence[str], is_alone: bool) -> None:
    """Run a step, check that all its files exist, and print its cost (`puckbench.steps.cost`)."""
    if len(words) < 2:
        raise InputError("usage: python -m puckbench.steps NAME SETTINGS key=FILE ...")
    name, settings, *rest = words
    kind = STEPS.get(name)
    step = kind.checked(_settings(settings), f"step {name}")
    key = next((word for word in rest if word.startswith(_KEY)), _KEY)
    files = _files(kind, [word for word in rest if word != key])
    by_name = {
        name: tuple(paths) if kind.takes_several(name) else paths[0]
        for name, paths in files.items()
        if paths
    }
    try:
        step.run(**by_name)
    finally:
        if is_alone:
            end_children()  # which may print: before the last line
    for path in (path for paths in files.values() for path in paths):
        if not path.exists():
            raise InputError(f"{path}: the step ended without this file")
    line = cost_line(name, key.removeprefix(_KEY))
    try:
        print(line, flush=True)  # noqa: T201
    except (OSError, ValueError) as error:
        fault = "cannot write to standard output, which a plug-in may have closed"
        raise InputError(f"{fault}: {error}") from error


def _settings(word: str) -> Any:
    if word.startswith("@"):
        return read_json(Path(word[1:]))
    return json_of(word.encode(), "the settings")


def _files(kind: type[Step], words: Sequence[str]) -> dict[str, list[Path]]:
    """Return absolute paths by key, since a user's plug-in may change the working folder."""
    parameters = signature(kind.run).parameters
    takes_any = any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values())
    files: dict[str, list[Path]] = {}
    for word in words:
        key, _, path = word.partition("=")
        if key in parameters or (takes_any and key.isidentifier()):
            files[key] = [Path(path).absolute()] if path else []
        elif key != word and key.isidentifier():
            known = ", ".join(name for name in parameters if name != "self")
            raise InputError(f"{word}: the step has no file {key!r} (known: {known})")
        elif files:
            files[next(reversed(files))].append(Path(word).absolute())
        else:
            raise InputError(f"{word}: must be key=FILE")
    needed = [
        name
        for name, parameter in parameters.items()
        if parameter.kind is parameter.POSITIONAL_OR_KEYWORD
        and parameter.default is parameter.empty
        and name not in (*files, "self")
    ]
    if needed:
        raise InputError(f"the step needs {', '.join(f'{name}=FILE' for name in needed)}")
    return files


def leave(status: int) -> NoReturn:
    """End this process with an exit status, without freeing memory, which saves 0.2 to 0.5 s."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):  # it is full or closed
            status = status or 1
    os._exit(status)

"""The process that runs one job, and prints its time and memory in the last line."""

from __future__ import annotations

import faulthandler
import gc
import os
import sys
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from inspect import signature
from io import UnsupportedOperation
from pathlib import Path
from typing import NoReturn

from pointkit.errors import InputError, error_text
from pointkit.files import read_json
from puckbench.jobs.cost import cost_line
from puckbench.jobs.registry import JOBS

TIMEOUT = "PUCKBENCH_TIMEOUT_S"
"""Environment variable with the time limit of a job in s; empty or 0 means no limit."""
_OBJECTS_PER_SEARCH = 10_000
"""Garbage collection threshold, raised since imports make many objects, but no garbage."""


def main(words: Sequence[str]) -> int:
    """Run a job, print a line about a failure to standard error, and return the exit status.

    `words` are the job's name, the path of the JSON file of its settings, and the paths of its
    input and output files as ``key=FILE``. Words without a key are further files of the last key.
    """
    gc.set_threshold(_OBJECTS_PER_SEARCH)
    with suppress(UnsupportedOperation):  # standard error may not be a file
        faulthandler.enable()
    if limit_s := float(os.environ.get(TIMEOUT) or 0):
        faulthandler.dump_traceback_later(limit_s, exit=True)
    name, record, *files = words
    folder = f"{Path.cwd()}{os.sep}"
    try:
        run_job(name, Path(record), _files(name, files))
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


def run_job(name: str, record: Path, files: Mapping[str, Sequence[Path]]) -> None:
    """Run a job, check that all its files exist, and print its cost (`puckbench.jobs.cost`).

    Parameters
    ----------
    name
        Name of the job in the registry `JOBS`.
    record
        JSON file of the job's settings.
    files
        Paths of input and output files, by name of a parameter of `Job.run`.
    """
    job = JOBS.get(name).of_record(read_json(record), f"job {name}")
    parameters = signature(job.run).parameters
    lists = {key for key, parameter in parameters.items() if "tuple" in str(parameter.annotation)}
    job.run(
        **{key: tuple(paths) if key in lists else paths[0] for key, paths in files.items() if paths}
    )
    for path in (path for paths in files.values() for path in paths):
        if not path.exists():
            raise InputError(f"{path}: the job ended without this file")
    print(cost_line(name, key=record.stem))  # noqa: T201


def _files(name: str, words: Sequence[str]) -> dict[str, list[Path]]:
    """Return absolute paths by key, since a user's plug-in may change the working folder."""
    parameters = signature(JOBS.get(name).run).parameters
    takes_any = any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values())
    files: dict[str, list[Path]] = {}
    for word in words:
        key, _, path = word.partition("=")
        if key in parameters or (takes_any and key.isidentifier()):
            files[key] = [Path(path).absolute()] if path else []
        else:
            files[next(reversed(files))].append(Path(word).absolute())
    return files


def leave(status: int) -> NoReturn:
    """End this process with an exit status, without freeing memory, which saves 0.2 to 0.5 s."""
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:
        sys.exit(status)  # Python then reports the error
    os._exit(status)

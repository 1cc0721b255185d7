from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import NamedTemporaryFile, TemporaryFile

from pointkit.errors import InputError
from pointkit.files import remove_leftovers, unreadable, unwritable

SNAKEMAKE_FOLDER = Path(".snakemake")
_held: list[int] = []
"""File descriptors of the locks, which close when the process ends."""
_ROOM = 2**20
"""Free disk space that a run needs to start, bytes."""
_MOST_LEFT_OUT = 50


def hold_results(results: Path) -> None:
    """Lock the results folder until this process ends, so that no other run writes to it.

    Temporary files that a killed run left are removed.

    Raises
    ------
    InputError
        Another run holds the lock, or the folder cannot be written.
    """
    import fcntl

    try:
        results.mkdir(parents=True, exist_ok=True)
        lock = os.open(results / ".lock", os.O_WRONLY | os.O_CREAT, 0o666)
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise InputError(f"{results}: another run is writing to this folder") from error
    except OSError as error:
        raise unreadable(results, error, "not writable") from error
    check_room(results)
    os.utime(lock)
    _held.append(lock)
    remove_leftovers(results)


def check_room(folder: Path) -> None:
    """Raise InputError if 1 MiB cannot be written to a folder, which is made if it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder) as probe:
            probe.write(bytes(_ROOM))
            probe.flush()
    except OSError as error:
        raise unwritable(folder, error) from error


def mark_planning() -> None:
    """Set the time of Snakemake's folder, in the working folder, to the present time.

    A file is made in it, which is deleted at once. By the clock of its file system, the folder is
    then newer than all results of earlier runs, so that Snakemake runs those jobs again whose rules
    have it as an input (`puckbench.planning.rules`).

    Raises
    ------
    InputError
        Snakemake cannot write there.
    """
    try:
        check_room(SNAKEMAKE_FOLDER)
        with NamedTemporaryFile(dir=SNAKEMAKE_FOLDER):
            pass
    except InputError as error:
        advice = "Snakemake writes there, also in a dry run: start it in another folder"
        raise InputError(f"{error}; {advice}") from error


def left_out_lines(rows: Sequence[Mapping[str, str]]) -> Iterator[str]:
    """Yield a line to print for each row of the table ``left_out``, up to 50 of them."""
    for row in rows[:_MOST_LEFT_OUT]:
        yield f"left out: {row['file']}: {row['reason']}"
    if len(rows) > _MOST_LEFT_OUT:
        yield f"left out: {len(rows) - _MOST_LEFT_OUT} more (tables/left_out.csv)"


def held_since() -> float:
    """Return the time stamp, in s, at which this process locked its results folder.

    The time is that of the file system. It is infinity if no folder is locked.
    """
    return os.fstat(_held[-1]).st_mtime if _held else math.inf

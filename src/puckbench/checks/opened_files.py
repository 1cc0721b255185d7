"""Files that this process opens, as Python reports them to audit hooks.

Files that other programs and compiled code open without Python are not seen.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_WRITING = os.O_WRONLY | os.O_RDWR
_CACHES = (".pyc", ".nbi", ".nbc")
"""Suffixes of files in which Python and numba keep compiled code."""
_OF_THE_SYSTEM = ("/dev/", "/proc/", "/sys/")
_opened: dict[Path, bool] = {}
"""Opened files, and whether they were opened for writing."""
_state = {"hooked": False, "recording": False}


@contextmanager
def recorded_files() -> Iterator[dict[Path, bool]]:
    """Record the files that are opened in a `with` block.

    Yields a mapping, which is complete at the end of the block: absolute paths of files, and
    whether they were opened for writing.
    """
    if not _state["hooked"]:
        sys.addaudithook(_record)  # for good: Python has no way to remove it
        _state["hooked"] = True
    _opened.clear()
    opened: dict[Path, bool] = {}
    _state["recording"] = True
    try:
        yield opened
    finally:
        _state["recording"] = False
        opened |= _opened


def _record(event: str, arguments: tuple[Any, ...]) -> None:
    if event != "open" or not _state["recording"]:
        return
    path, _, flags = arguments
    if not isinstance(path, str | bytes):  # a file descriptor
        return
    file = os.path.abspath(os.fsdecode(path))  # noqa: PTH100 (Path.absolute keeps ..)
    if not file.endswith(_CACHES) and not file.startswith(_OF_THE_SYSTEM):
        is_written = isinstance(flags, int) and bool(flags & _WRITING)
        _opened[Path(file)] = _opened.get(Path(file), False) or is_written

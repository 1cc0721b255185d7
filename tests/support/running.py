"""Processes that run at present."""

from __future__ import annotations

from pathlib import Path


def processes_in(folder: Path) -> list[str]:
    """The commands of the processes that run in a folder."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if (process / "cwd").readlink() == folder:
                found.append((process / "cmdline").read_text().replace("\0", " "))
        except OSError:  # ended
            pass
    return found

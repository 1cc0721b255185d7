"""The folder in which compiled loops are kept between processes."""

from __future__ import annotations

import os
from pathlib import Path


def loops_folder(sources: Path) -> Path:
    """The folder for the compiled loops of a folder of sources.

    ``NUMBA_CACHE_DIR`` where that is set; else ``__pycache__`` beside the sources, so that they are
    removed together; else, where an installation may not be written to (a container, another user's
    environment), ``puckbench`` in the user's cache.
    """
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen)
    if os.access(sources, os.W_OK):
        return sources / "__pycache__"
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 (Path raises without a home)
    return Path(caches, "puckbench")

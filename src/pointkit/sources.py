"""Source files of packages; digests of them tell whether compiled code is up to date."""

from __future__ import annotations

import hashlib
import os
from functools import cache
from pathlib import Path


@cache
def package_folder(file: Path) -> Path:
    """Return the folder of the top-level package to which a file belongs.

    For a file in no package, this is the folder of the file.
    """
    folder = file.parent
    while (folder.parent / "__init__.py").exists() and (folder / "__init__.py").exists():
        folder = folder.parent
    return folder


def import_folder(file: Path) -> Path:
    """Return the folder that must be on Python's search path so that a file can be imported.

    This is the folder that contains the file's top-level package; for a file in no package, its own
    folder.
    """
    folder = package_folder(file)
    return folder.parent if (folder / "__init__.py").exists() else folder


def package_files(folder: Path) -> list[Path]:
    """Return the Python files of a package and its subpackages.

    If the folder is no package, only the files directly in it are returned.
    """
    inner = (folder / "__init__.py").exists()
    return sorted(folder.rglob("*.py") if inner else folder.glob("*.py"))


@cache
def sources_digest(folder: Path) -> bytes:
    """Return a digest of the names and contents of a package's files (`package_files`)."""
    digest = hashlib.sha256()
    for file in package_files(folder):
        digest.update(file.relative_to(folder).as_posix().encode() + b"\0")
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.digest()


def loops_folder(sources: Path) -> Path:
    """Return the folder that caches the compiled functions of a folder of sources.

    It is the environment variable ``NUMBA_CACHE_DIR`` if set. Otherwise it is ``__pycache__``
    beside the sources or, if these are read-only, ``puckbench`` in the user's cache folder.
    """
    if folder := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(folder)
    if os.access(sources, os.W_OK):
        return sources / "__pycache__"
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 (Path raises without a home)
    return Path(caches, "puckbench")

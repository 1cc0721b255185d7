"""Modules with which loaders read the files of scenes, for fingerprints of the steps that do so."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cloud_files import clouds
from cloud_files.content import plain_suffix
from cloud_files.meshes import reading as meshes
from puckbench.scene_sets import recordings
from puckbench.scene_sets.registry import LOADERS


def loader_modules(loader: str, files: Iterable[str | Path]) -> list[str]:
    """Return the names of the modules with which a loader reads the files of a scene.

    They are the module of the loader, and the modules of the files' formats.
    """
    return [LOADERS.module_of(loader), *reader_modules(files)]


def reader_modules(files: Iterable[str | Path]) -> list[str]:
    """Return the names of the modules that read the formats of files.

    If the suffix of any file is unknown, the modules of all formats are returned.
    """
    readers = {**clouds.READERS, **meshes.READERS, **recordings.READERS}
    suffixes = {plain_suffix(Path(file)) for file in files} - {".ply", *recordings.CAPTURE_SUFFIXES}
    used = suffixes if suffixes <= readers.keys() else readers.keys()
    modules = {readers[suffix].partition(":")[0] for suffix in used}
    return sorted({name for module in modules for name in _PARTS.get(module, (module,))})


_PARTS = {
    "cloud_files.las": ("cloud_files.las", "cloud_files.las_header", "cloud_files.las_units"),
    "cloud_files.text": ("cloud_files.text", "cloud_files.text_numbers"),
    "puck.recording": ("puck.*",),
}
"""Modules that belong together, for readers whose code is in several modules."""

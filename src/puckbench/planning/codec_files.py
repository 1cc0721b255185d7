"""Files besides Python code on which the results of a codec depend."""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Iterator, Mapping, Set
from pathlib import Path
from typing import Any

from puckbench.codecs.base import Codec
from puckbench.codecs.external import ExternalCodec
from puckbench.codecs.registry import Entry, module_of
from puckbench.planning.file_digests import file_digests
from puckbench.planning.memory import Memory
from puckbench.steps.fingerprints import covered
from puckbench.steps.user_code import named_files, with_libraries

_PROGRAMS, _FILES = ".programs.json", ".codec_files.json"
"""Names under which the digests of programs, and of single files, are stored."""


def program_digests(codec: Codec, memory: Memory) -> list[str]:
    """Return digests of the programs that a codec runs, with the shared libraries beside them.

    There are none for codecs that are not `ExternalCodec`. A missing program counts as unchanged, so
    that its results are kept on machines without it; its digest is empty if it was never there.

    Parameters
    ----------
    codec
        The codec.
    memory
        Stores the digests between runs.
    """
    if not isinstance(codec, ExternalCodec):
        return []
    known = {name: str(digest) for name, digest in memory.read(_PROGRAMS).items()}
    found = {name: Path(path).resolve() for name in codec.programs if (path := shutil.which(name))}
    digests = {name: _digest({path}, memory) for name, path in found.items()}
    if not digests.items() <= known.items():
        memory.learn(_PROGRAMS, {**known, **digests})
    return [{**known, **digests}.get(name, "") for name in codec.programs]


def named_files_digest(entry: Entry, without: Set[Path], memory: Memory) -> str:
    """Return a digest of the files that the code, options and rates of a user's codec name.

    It is empty if there are none.

    Parameters
    ----------
    entry
        The codec's complete entry in the configuration.
    without
        Absolute paths of files and folders that do not count, such as the results.
    memory
        Stores the digests between runs.
    """
    module = module_of(entry["class"])
    if module.endswith(".py"):
        module = str(Path(module).absolute())
    file = Path(module if module.endswith(".py") else str(importlib.import_module(module).__file__))
    options = _texts({key: value for key, value in entry.items() if key != "class"})
    return _digest(named_files(file, options, without) - covered(module), memory)


def _digest(files: Set[Path], memory: Memory) -> str:
    """Return the joined digests of files and of the libraries beside them, empty without any."""
    paths = sorted(with_libraries(files), key=lambda path: (path.name, path))
    return " ".join(digest[:16] for digest in file_digests(paths, memory, _FILES).values())


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, Mapping):
        value = value.values()
    if isinstance(value, str | Path):
        yield str(value)
    elif not isinstance(value, bytes) and hasattr(value, "__iter__"):
        for each in value:
            yield from _texts(each)

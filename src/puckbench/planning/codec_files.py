"""Files besides Python code on which the results of a codec depend."""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Iterator, Mapping, Set
from pathlib import Path
from typing import Any

from puckbench.codecs.base import Codec
from puckbench.codecs.external import program_names
from puckbench.codecs.registry import Entry, module_of
from puckbench.planning.file_digests import file_digests
from puckbench.planning.memory import Memory
from puckbench.steps.fingerprints import covered
from puckbench.steps.user_code import named_files, with_libraries

_PROGRAMS, _FILES = ".programs.json", ".codec_files.json"
"""Names under which the digests of programs, and of single files, are stored."""


def program_digests(codec: Codec, memory: Memory) -> list[str]:
    """Return digests of the programs that a codec runs, with the libraries beside them.

    A missing program counts as unchanged, so that results are kept on machines without it. If it
    was never there, its digest is empty.

    Parameters
    ----------
    codec
        The codec.
    memory
        Stores the digests between runs.
    """
    known = {name: str(digest) for name, digest in memory.read(_PROGRAMS).items()}
    files = {name: with_libraries({file.resolve()}) for name, file in _programs(codec).items()}
    digests = {name: files_digest(each, memory) for name, each in files.items()}
    if not digests.items() <= known.items():
        memory.learn(_PROGRAMS, {**known, **digests})
    return [{**known, **digests}.get(name, "") for name in program_names(codec)]


def files_of_codec(codec: Codec, entry: Entry, without: Set[Path]) -> set[Path]:
    """Return the files that the code, options and rates of a user's codec name.

    The codec's code and the programs that it runs are not among them, but libraries beside them.

    Parameters
    ----------
    codec, entry
        The codec, and its complete entry in the configuration.
    without
        Absolute paths of files and folders that do not count, such as the results.
    """
    module = module_of(entry["class"])
    if module.endswith(".py"):
        module = str(Path(module).absolute())
    file = Path(module if module.endswith(".py") else str(importlib.import_module(module).__file__))
    options = _texts({key: value for key, value in entry.items() if key != "class"})
    programs = {*_programs(codec).values()}
    return with_libraries(named_files(file, options, without | programs) - covered(module))


def files_digest(files: Set[Path], memory: Memory) -> str:
    """Return a text with the digests of files, which `memory` stores; it is empty without files."""
    paths = sorted(files, key=lambda path: (path.name, path))
    return " ".join(digest[:16] for digest in file_digests(paths, memory, _FILES).values())


def _programs(codec: Codec) -> dict[str, Path]:
    """Return the absolute paths of a codec's programs that are on this machine, by name."""
    found = {name: shutil.which(name) for name in program_names(codec)}
    return {name: Path(path).absolute() for name, path in found.items() if path}


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, Mapping):
        value = value.values()
    if isinstance(value, str | Path):
        yield str(value)
    elif not isinstance(value, bytes) and hasattr(value, "__iter__"):
        for each in value:
            yield from _texts(each)

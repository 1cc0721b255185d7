"""One file of the corpus: how it is written, and what a reader must make of it."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import tests.corpus

Reader = Literal["cloud", "mesh", "returns", "turns"]


@dataclass(frozen=True)
class Case:
    """A file of the corpus.

    Parameters
    ----------
    file
        Its name, which is also the name of the test.
    write
        Writes it (and, where the case needs them, files beside it) at a path.
    reader
        What reads it: a cloud (`read_cloud`), a mesh (`read_mesh`), the returns of a recording
        (`read_recording`), or its turns (`read_turns`).
    points
        The right points, (n, 3), in the order of the file; or the vertices of a mesh.
    line
        Regular expression of the one line that refuses the file, searched from its beginning.
    remark
        Regular expression of a line that is logged while the file is read.
    fields
        Some of the cloud's fields by name, (n,) each, with their right values.
    area
        The area of a mesh.
    options
        Keyword arguments of the reader.
    """

    file: str
    write: Callable[[Path], Any]
    reader: Reader
    points: Sequence[Any] | None = None
    line: str | None = None
    remark: str | None = None
    fields: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    area: float | None = None
    options: Mapping[str, Any] = field(default_factory=dict)


def content(data: bytes | str) -> Callable[[Path], None]:
    """Writes these bytes, or this text in UTF-8."""
    raw = data.encode() if isinstance(data, str) else data
    return lambda path: path.write_bytes(raw) and None


TWO = [(1, 2, 3), (4, 5, 6)]
"""The points of most clouds of the corpus."""


def cloud_case(
    file: str,
    data: bytes | str | Callable[[Path], Any],
    points: Any = TWO,
    line: str | None = None,
    **more: Any,
) -> Case:
    """A cloud's file, by its content or its writer, and its points or the line that refuses it."""
    write = data if callable(data) else content(data)
    return Case(file, write, "cloud", None if line else points, line, **more)


def cases() -> Iterator[Case]:
    """The cases of all modules of the corpus (their ``CASES``)."""
    for module in sorted(module.name for module in pkgutil.iter_modules(tests.corpus.__path__)):
        if not module.startswith("test_") and module not in ("case", "__main__"):
            yield from importlib.import_module(f"tests.corpus.{module}").CASES

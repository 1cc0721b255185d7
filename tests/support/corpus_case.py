"""A file of a corpus: how it is written, and the expected result of reading it."""

from __future__ import annotations

import importlib
import logging
import pkgutil
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import numpy as np
import pytest

from pointkit.errors import InputError

Reader = Literal["cloud", "mesh", "returns", "turns"]


@dataclass(frozen=True)
class Case:
    """A file of the corpus.

    Parameters
    ----------
    file
        Name of the file and of the test.
    write
        Writes the file, and files beside it, at a path.
    reader
        "cloud" (`read_cloud`), "mesh" (`read_mesh`), "returns" (`read_recording`) or "turns"
        (`read_turns`).
    points
        Expected points, (n, 3), or vertices of a mesh.
    error
        Regular expression of the expected error message.
    warning
        Regular expression of an expected warning.
    fields
        Expected fields of a cloud by name, (n,) each.
    area
        Expected area of a mesh.
    options
        Keyword arguments of the reader.
    """

    file: str
    write: Callable[[Path], Any]
    reader: Reader
    points: Sequence[Any] | None = None
    error: str | None = None
    warning: str | None = None
    fields: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    area: float | None = None
    options: Mapping[str, Any] = field(default_factory=dict)


def content(data: bytes | str) -> Callable[[Path], None]:
    """Return a function that writes bytes, or text in UTF-8."""
    raw = data.encode() if isinstance(data, str) else data
    return lambda path: path.write_bytes(raw) and None


TWO = [(1, 2, 3), (4, 5, 6)]
"""Points of most clouds of the corpus."""


def cloud_case(
    file: str,
    data: bytes | str | Callable[[Path], Any],
    points: Any = TWO,
    error: str | None = None,
    **more: Any,
) -> Case:
    """Make a case of a cloud from the file's content or writer."""
    write = data if callable(data) else content(data)
    return Case(file, write, "cloud", None if error else points, error, **more)


def cases(corpus: ModuleType) -> Iterator[Case]:
    """Yield the ``CASES`` of all modules of a corpus, which is a package."""
    for module in sorted(module.name for module in pkgutil.iter_modules(corpus.__path__)):
        if not module.startswith(("test_", "__")):
            yield from importlib.import_module(f"{corpus.__name__}.{module}").CASES


def check(
    case: Case,
    folder: Path,
    caplog: pytest.LogCaptureFixture,
    read: Callable[[Case, Path], tuple[Any, Any]],
) -> None:
    """Assert that `read`, which returns points and further columns, gives what a case expects."""
    path = folder / case.file
    case.write(path)
    with caplog.at_level(logging.WARNING):
        if case.error is not None:
            with pytest.raises(InputError) as refusal:
                read(case, path)
            message = str(refusal.value)
            assert re.search(case.error, message), message
            assert "\n" not in message
            return
        points, columns = read(case, path)
    assert case.points is not None
    np.testing.assert_allclose(points, np.asarray(case.points, dtype=float), rtol=0, atol=1e-9)
    for name, values in case.fields.items():
        np.testing.assert_array_equal(columns[name], values)
    if case.area is not None:
        assert columns["area"] == pytest.approx(case.area, rel=1e-6)
    lines = [record.getMessage() for record in caplog.records]
    if case.warning is None:
        assert not lines
    else:
        assert any(re.search(case.warning, line) for line in lines), lines

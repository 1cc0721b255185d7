"""Clouds as text: a line of numbers for each point (XYZ, CSV, TXT, ASC, PTS)."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.io.point_columns import Columns, named_columns

_LOOKED_AT = 1 << 16
_COMMENT = ("#", "//")


def read_text(path: Path) -> Columns:
    """Read the columns of a file, by the names in its first line where that has any.

    Numbers are separated by commas, semicolons or blanks, and read to the nearest double. Lines of
    comments, and a line before the points with their number (PTS), are left out.

    Raises
    ------
    InputError
        The file is missing, empty, has lines that are no numbers, or not as many as it says.
    """
    data = read_bytes(path).removeprefix("\ufeff".encode())
    skipped, names, count, first = _head(data[:_LOOKED_AT].decode("utf-8", "replace").splitlines())
    if not first:
        raise InputError(f"{path}: the cloud is empty")
    parts = _parsed(re.sub(rb"\A(?:[^\n]*\n){%d}" % skipped, b"", data), first, path)
    if count is not None and count != len(parts[0]):
        raise InputError(f"{path}: {len(parts[0])} points where its head says {count}")
    if names and len(names) < len(parts):
        raise InputError(f"{path}: its first line has {len(names)} names for {len(parts)} columns")
    are_numbers = [part.dtype.kind in "fiu" for part in parts]
    if not names:
        if len(parts) < 3 or not all(are_numbers):
            raise InputError(f"{path}: not a table of numbers (a line begins {first[:40]!r})")
        names = list(named_columns(np.column_stack(parts)))
    named = zip(names, parts, are_numbers, strict=False)
    return {name: part for name, part, is_numbers in named if is_numbers}


def _parsed(data: bytes, first: str, path: Path) -> list[NDArray[Any]]:
    """The columns of lines that are separated as the first one is; empty columns are left out."""
    import pyarrow as pa
    from pyarrow import csv

    mark = next((mark for mark in ",;" if mark in first), " ")
    if mark == " ":
        data = re.sub(rb"(?m)^ | (?=\r?$)", b"", re.sub(rb"[ \t]+", b" ", data))
    try:
        table = csv.read_csv(
            io.BytesIO(data),
            csv.ReadOptions(autogenerate_column_names=True),
            csv.ParseOptions(delimiter=mark),
        )
    except pa.ArrowException as error:
        fault = " ".join(str(error).split())
        raise InputError(f"{path}: not a table of numbers ({fault})") from error
    return [column.to_numpy() for column in table.columns if not pa.types.is_null(column.type)]


def _head(lines: list[str]) -> tuple[int, list[str], int | None, str]:
    """Lines before the points, names of the columns, the number of points if it is said, and the
    first line of a point."""
    names: list[str] = []
    count: int | None = None
    for place, line in enumerate(lines):
        words = [word.strip("\"' ") for word in re.split(r"[,;\s]+", line.strip(" ,;\t"))]
        commented = line.lstrip().startswith(_COMMENT)
        bare = [word for word in (word.lstrip("/#") for word in words) if word]
        if {"x", "y", "z"} <= {word.lower() for word in bare}:
            names = bare
        elif bare and not commented:
            if count is not None or len(bare) > 1 or not bare[0].isdecimal():
                return place, names, count, line
            count = int(bare[0])
    return len(lines), names, count, ""

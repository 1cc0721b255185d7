"""What the header of a PLY file announces, checked against the file's size."""

from __future__ import annotations

from pathlib import Path

from puckbench.core.errors import InputError
from puckbench.core.files import unreadable

_HEADER_BYTES = 1 << 20
_SIZES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "float", "int32", "uint32", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}
_DIGIT_AND_BLANK = 2


def check_counts(path: Path) -> None:
    """Raise InputError where a PLY file is too short for the rows that its header announces.

    What a header says else is for a reader to judge: lines that are not understood are passed over.
    """
    try:
        with path.open("rb") as stream:
            start = stream.read(_HEADER_BYTES)
    except OSError as error:
        raise unreadable(path, error) from error
    head, _, _ = start.partition(b"end_header")
    rows = [line.split() for line in head.decode("latin-1").splitlines()]
    size = path.stat().st_size - len(head)
    for name, count, least in _elements(rows):
        if count * least > size + 1:
            fault = f"{count} rows of {name!r} do not fit in {size} bytes"
            raise InputError(f"{path}: not a readable PLY file (truncated: {fault})")


def _elements(rows: list[list[str]]) -> list[tuple[str, int, int]]:
    """Name, number of rows and least bytes of a row (a list may be empty) of each element."""
    is_text = ["format", "ascii"] in [row[:2] for row in rows]
    elements: list[tuple[str, int, int]] = []
    for row in rows:
        if row[:1] == ["element"] and len(row) == 3 and row[2].isdecimal():
            elements.append((row[1], int(row[2][:18]), 0))
        elif row[:1] == ["property"] and len(row) > 2 and elements:
            kind = row[2] if row[1] == "list" else row[1]
            name, count, least = elements[-1]
            more = _DIGIT_AND_BLANK if is_text else _SIZES.get(kind, 1)
            elements[-1] = (name, count, least + more)
    return elements

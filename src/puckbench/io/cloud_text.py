"""Points as text: a line of numbers for each (XYZ, CSV, TXT, ASC, PTS)."""

from __future__ import annotations

import codecs
import csv
import io
import logging
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.content import read_content
from puckbench.core.errors import InputError, naming
from puckbench.io.point_columns import Columns, named_columns, names_coordinates

_LOOKED_AT = 1 << 16
_COMMENT = ("#", "//")
_COMMENTS = re.compile(rb"(?m)^[ \t]*(?:#|//)[^\n]*\n?")
_COUNT = re.compile(r"[ \t]*\d{1,18}[ \t]*", re.ASCII)
_COUNTS = re.compile(rb"(?m)^[ \t]*(\d{1,18})[ \t]*(?:\n|\Z)")
_NUMBER = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)(e[-+]?\d+)?|[-+]?(nan|inf)", re.IGNORECASE)
_COMMA = re.compile(r"[-+]?\d+,\d+(e[-+]?\d+)?", re.IGNORECASE)
_MARKS = ";,\t "
_FEWEST = 3
"""Numbers in the line of a point."""
_BYTES = "latin-1"
"""Every byte as a character."""
_MOST_COMMENTS = 100
"""Before the points, among which one may have their names."""
_MOST_BLOCK = 2**31 - 1
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Head:
    """What stands before the points.

    Parameters
    ----------
    titles
        Lines of words, in order.
    comments
        Comments without their marks, in order.
    has_count
        Whether a line has the number of points (PTS).
    first
        The line of the first point.
    """

    titles: Sequence[str]
    comments: Sequence[str]
    has_count: bool
    first: str


def read_text(path: Path) -> Columns:
    """Read the columns of a file, by the names in a line before the points where it has one.

    Names and numbers are separated alike: by commas, semicolons, tabulators or blanks. Numbers are
    read to the nearest double, also with a decimal comma. Comments, lines with a number of points
    (PTS), and columns of other values than numbers are left out.

    Raises
    ------
    InputError
        The file is missing, empty, has lines that are no numbers, or not as many names or points as
        it should have.
    """
    data = read_content(path)
    with naming(path):
        names, parts = _table(_lines(data), path)
        return _numbers(names, parts, path)


def _lines(data: bytes) -> bytes:
    """Text in UTF-8, whatever its encoding and the ends of its lines."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        data = data.decode("utf-16", "replace").encode()
    if b"\0" in data[:_LOOKED_AT]:
        raise InputError("not a text file")
    data = data.removeprefix(codecs.BOM_UTF8).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return re.sub(rb"(?m)^[ \t]+$", b"", data)


def _table(data: bytes, path: Path) -> tuple[list[str], list[NDArray[Any]]]:
    """Names and columns of text."""
    head = _head(line.rstrip("\n") for line in io.TextIOWrapper(io.BytesIO(data), _BYTES))
    if not head.first:
        raise InputError("the cloud is empty")
    body, count = _body(data, head)
    mark = _mark(head.first)
    parts = _parsed(body, mark)
    if count not in (None, len(parts[0])):
        raise InputError(f"{len(parts[0])} points where its head says {count}")
    names = _names(head, mark, parts)
    return (names, parts[: len(names)]) if names else _unnamed(parts, head.first, path)


def _head(lines: Iterable[str]) -> _Head:
    titles: list[str] = []
    comments: list[str] = []
    has_count = False
    for line in lines:
        words = re.split(r"[,;\s]+", line.strip(" ,;\t"))
        numbers = sum(_NUMBER.fullmatch(word.strip("\"'")) is not None for word in words)
        if line.lstrip().startswith(_COMMENT):
            comments.append(line.strip().lstrip("#/").strip())
        elif words == [""]:
            continue
        elif not has_count and _COUNT.fullmatch(line):
            has_count = True
        elif numbers >= _FEWEST or numbers == len(words):
            return _Head(titles, comments, has_count, line)
        else:
            titles.append(line)
    return _Head(titles, comments, has_count, "")


def _body(data: bytes, head: _Head) -> tuple[bytes, int | None]:
    """The lines of points, and their number where lines say it."""
    if head.comments or b"#" in data or b"//" in data:
        data = _COMMENTS.sub(b"", data)
    count = None
    if head.has_count:
        count = sum(map(int, _COUNTS.findall(data)))
        data = _COUNTS.sub(b"", data)
    for _ in head.titles:
        data = data.lstrip(b"\n").partition(b"\n")[2]
    for title in head.titles:  # again where files were joined
        data = data.replace(f"\n{title}\n".encode(_BYTES), b"\n")
    return data, count


def _mark(line: str) -> str:
    """What separates the values of a line."""
    words, fields = line.split(), [field.split() for field in line.rstrip().split("\t")]
    if ";" in line:
        return ";"
    if "," in line and not (len(words) >= _FEWEST and all(map(_COMMA.fullmatch, words))):
        return ","
    return "\t" if len(fields) > 1 and all(map(_is_field, fields)) else " "


def _is_field(words: Sequence[str]) -> bool:
    """Whether words between two tabulators are one value: a number, or a text without numbers."""
    return len(words) == 1 or (bool(words) and not any(map(_NUMBER.fullmatch, words)))


def _parsed(data: bytes, mark: str) -> list[NDArray[Any]]:
    """The columns of lines; empty columns as nan."""
    import pyarrow as pa
    from pyarrow import csv as arrow

    if mark == " ":
        data = re.sub(rb"(?m)^ | $", b"", re.sub(rb"[ \t]+", b" ", data))
    is_comma = mark != "," and re.search(rb"\d,\d", data[:_LOOKED_AT])
    try:
        table = arrow.read_csv(
            io.BytesIO(data),
            # Types are those of all values, not of the first ones.
            arrow.ReadOptions(
                autogenerate_column_names=True, block_size=min(len(data) + 1, _MOST_BLOCK)
            ),
            arrow.ParseOptions(delimiter=mark),
            arrow.ConvertOptions(decimal_point="," if is_comma else "."),
        )
    except pa.ArrowException as error:
        fault = " ".join(str(error).split())
        raise InputError(f"not a table of numbers ({fault})") from error
    return [
        np.full(len(column), np.nan) if pa.types.is_null(column.type) else column.to_numpy()
        for column in table.columns
    ]


def _names(head: _Head, mark: str, parts: Sequence[NDArray[Any]]) -> list[str]:
    """Names of the columns; none where no line before the points has any.

    InputError where a line has more or fewer names than there are columns, or one twice.
    """
    texts = head.titles or list(filter(_may_name, head.comments[-_MOST_COMMENTS:]))
    fitting = [names for text in texts if (names := _fitting(text, mark, parts))]
    if texts and not fitting:
        given = len(_split(texts[-1], mark))
        raise InputError(f"{given} names ({texts[-1][:60]!r}) for {len(parts)} columns")
    names = next(filter(names_coordinates, reversed(fitting)), fitting[-1] if fitting else [])
    for name, count in Counter(map(str.lower, filter(None, names))).items():
        if count > 1:
            raise InputError(f"two columns are named {name}")
    return names


def _may_name(comment: str) -> bool:
    return any(names_coordinates(_split(comment, mark)) for mark in _MARKS)


def _fitting(text: str, mark: str, parts: Sequence[NDArray[Any]]) -> list[str]:
    """The names in a line, if they are as many as the columns, but for empty ones at the end.

    They may be separated otherwise than the numbers, as those of numpy.savetxt.
    """
    every = [_split(text, each) for each in (mark, *_MARKS)]
    fitting = [
        names
        for names in every
        if len(names) <= len(parts) and all(map(_is_empty, parts[len(names) :]))
    ]
    return next(filter(names_coordinates, fitting), fitting[0] if fitting else [])


def _split(text: str, mark: str) -> list[str]:
    """The names in a line, without empty ones at its end."""
    line = " ".join(text.split()) if mark == " " else text
    line = line.encode(_BYTES).decode("utf-8", "replace").strip(" \n")
    names = [name.strip(" \t\"'") for name in next(csv.reader([line], delimiter=mark), [])]
    while names and not names[-1]:
        names.pop()
    return names


def _unnamed(
    parts: list[NDArray[Any]], first: str, path: Path
) -> tuple[list[str], list[NDArray[Any]]]:
    """Customary names for the columns of a table without a header, and these columns."""
    while parts and _is_empty(parts[-1]):
        parts = parts[:-1]
    if len(parts) < _FEWEST or not all(part.dtype.kind in "fiu" for part in parts):
        raise InputError(f"not a table of numbers (a line begins {first[:40]!r})")
    points = _without_numbers_of_columns(parts)
    if points is not parts:
        _log.warning("%s: its first line numbers the columns, and is no point", path)
    return list(named_columns(np.column_stack(points))), points


def _without_numbers_of_columns(parts: list[NDArray[Any]]) -> list[NDArray[Any]]:
    """Columns without a first line 0, 1, 2, ..., by which pandas names those that have no name.

    Where that line begins with an empty value, the first column numbers the rows.
    """
    first = [float(part[0]) for part in parts]
    has_index = bool(np.isnan(first[0])) and len(parts) > _FEWEST
    if first[has_index:] != [*map(float, range(len(parts) - has_index))]:
        return parts
    is_whole = all((part == np.rint(part)).all() for part in parts)
    return parts if is_whole and not has_index else [part[1:] for part in parts[has_index:]]


def _is_empty(part: NDArray[Any]) -> bool:
    return part.dtype.kind == "f" and bool(np.isnan(part).all())


def _numbers(names: Sequence[str], parts: Sequence[NDArray[Any]], path: Path) -> Columns:
    """Numeric columns by name; the names of the other columns are logged."""
    named = {name: part for name, part in zip(names, parts, strict=True) if name}
    numbers = {name: part for name, part in named.items() if part.dtype.kind in "fiu"}
    others = [name for name in named if name not in numbers]
    if names_coordinates(named) and not names_coordinates(numbers):
        raise InputError(f"not a table of numbers ({_odd_value(others[0], named)})")
    if others:
        _log.warning("%s: columns without numbers are left out: %s", path, ", ".join(others))
    return numbers


def _odd_value(name: str, named: Columns) -> str:
    texts = map(str, named[name])
    odd = next((text for text in texts if not _NUMBER.fullmatch(text.strip())), "")
    return f"column {name} has {odd!r}"

"""Tables of numbers in text files (.xyz, .txt, .csv, .asc, .pts) as clouds."""

from __future__ import annotations

import codecs
import csv
import io
import logging
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.content import read_content
from cloud_files.point_columns import (
    coordinate_names,
    decoded,
    default_columns,
    has_coordinates,
)
from cloud_files.text_numbers import (
    MIN_NUMBERS,
    NUMBER,
    check_comma_separated,
    check_six_numbers,
    decimal_sign,
    fault_of_number,
    have_decimal_commas,
    with_e_exponents,
)
from pointkit.damage import one_line
from pointkit.errors import InputError, naming
from pointkit.files import written_whole
from pointkit.isolated import Columns

_BINARY_CHECK_BYTES = 1 << 16
_COMMENT = ("#", "//")
_COMMENTS = re.compile(rb"(?m)^[ \t]*(?:#|//)[^\n]*\n?")
_COUNT = re.compile(r"[ \t]*\d{1,18}[ \t]*", re.ASCII)
_COUNTS = re.compile(rb"(?m)^[ \t]*(\d{1,18})[ \t]*(?:\n|\Z)")
_UNIT = re.compile(r"[\[(]?(um|mm|cm|dm|km|ft|feet|foot|in|inch|inches)[\])]?", re.IGNORECASE)
_SEPARATORS = ";,\t "
_BYTE_ENCODING = "latin-1"
_MAX_COMMENTS = 100
"""Maximum number of comments before the points that are searched for column names."""
_MAX_BLOCK_BYTES = 2**31 - 1
_EXACT_INTEGERS = 2**53
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _TextHeader:
    """The lines of a text file before its points, and the line of the first point.

    `has_count` says that one of these lines is the number of points, as in PTS files.
    """

    titles: Sequence[str]
    comments: Sequence[str]
    has_count: bool
    first: str


def read_text(path: Path) -> Columns:
    """Read the numeric columns of a text file that has one point in each line.

    Values are separated by commas, semicolons, tabs or blanks, and may have a decimal comma. The
    names of the columns come from a line or comment before the points. Without it, columns are
    named by their number and values (`cloud_files.point_columns.default_columns`). Columns without
    numbers are left out, with a warning.

    Returns
    -------
    dict
        Arrays (n,) by name.

    Raises
    ------
    InputError
        The file is not a table of numbers, or it could be read in more than one way.
    """
    data = read_content(path)
    with naming(path):
        return _columns(_unified(data), path)


def read_csv(path: Path) -> Columns:
    """Read a text file as `read_text` does, but return the names of columns in lowercase."""
    return {name.lower(): values for name, values in read_text(path).items()}


def write_csv(path: str | Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write a CSV file: a line of names, and then one line for each point.

    Parameters
    ----------
    path
        The file to write.
    columns
        Arrays (n,) by name. Numbers are written with as few digits as give back the same value.
    """
    import pyarrow as pa
    from pyarrow import csv

    table = pa.table({name: np.ascontiguousarray(part) for name, part in columns.items()})
    with written_whole(path) as temporary:
        csv.write_csv(table, temporary, csv.WriteOptions(quoting_style="none"))


def _unified(data: bytes) -> bytes:
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        data = data.decode("utf-16", "replace").encode()
    if b"\0" in data[:_BINARY_CHECK_BYTES]:
        raise InputError("not a text file")
    data = data.removeprefix(codecs.BOM_UTF8).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return re.sub(rb"(?m)^[ \t]+$", b"", data)


def _columns(data: bytes, path: Path) -> Columns:
    lines = io.TextIOWrapper(io.BytesIO(data), _BYTE_ENCODING)
    header = _header(line.rstrip("\n") for line in lines)
    if not header.first:
        raise _no_points(header.titles)
    body, count = _body(data, header)
    separator = _separator(header)
    if separator == "," and not header.titles:
        check_comma_separated(body)
    decimal = decimal_sign(body, separator, path)
    columns = _parsed(with_e_exponents(body, header.first), separator, decimal)
    if count not in (None, len(columns[0])):
        raise InputError(f"{len(columns[0])} points, but its header says {count}")
    if names := _names(header, separator, columns):
        _check_titles(header.titles, separator, path)
        columns = columns[: len(names)]
    else:
        names, columns = _with_default_names(columns, header.first, separator, path)
    return _numeric_columns(names, columns, decimal, path)


def _no_points(titles: Sequence[str]) -> InputError:
    odd = (line for line in titles if re.search(r"\d", line) and not _has_names(line))
    line = next(odd, None)
    return InputError("the cloud is empty") if line is None else _no_table(line)


def _no_table(line: str) -> InputError:
    return InputError(f"not a table of numbers (a line begins {_real(line)[:40]!r})")


def _real(line: str) -> str:
    return decoded(line.encode(_BYTE_ENCODING))


def _check_titles(titles: Sequence[str], separator: str, path: Path) -> None:
    """Raise InputError if titles look like a point; warn if they name units other than metres."""
    places: list[int] = []
    for line in titles:
        fields = _split(line, separator)
        if any(map(NUMBER.fullmatch, fields)) and len(fields) >= MIN_NUMBERS and places:
            raise _no_table(line)
        units = {fields[place] for place in places if place < len(fields)}
        if len(units) == 1 and _UNIT.fullmatch(unit := units.pop()):
            _log.warning("%s: its unit, %s, is not applied: use --metres-per-unit", path, unit)
        places = places or [fields.index(name) for name in coordinate_names(fields)]


def _header(lines: Iterable[str]) -> _TextHeader:
    titles: list[str] = []
    comments: list[str] = []
    has_count = False
    for line in lines:
        words = re.split(r"[,;\s]+", line.strip(" ,;\t"))
        numbers = sum(NUMBER.fullmatch(word.strip("\"'")) is not None for word in words)
        if line.lstrip().startswith(_COMMENT):
            comments.append(line.strip().lstrip("#/").strip())
        elif words == [""]:
            continue
        elif not has_count and _COUNT.fullmatch(line):
            has_count = True
        elif numbers >= MIN_NUMBERS or numbers == len(words):
            return _TextHeader(titles, comments, has_count, line)
        else:
            titles.append(line)
    return _TextHeader(titles, comments, has_count, "")


def _body(data: bytes, header: _TextHeader) -> tuple[bytes, int | None]:
    if header.comments or b"#" in data or b"//" in data:
        data = _COMMENTS.sub(b"", data)
    count = None
    if header.has_count:
        count = sum(map(int, _COUNTS.findall(data)))
        data = _COUNTS.sub(b"", data)
    for _ in header.titles:
        data = data.lstrip(b"\n").partition(b"\n")[2]
    for title in header.titles:  # concatenated files repeat them
        data = data.replace(f"\n{title}\n".encode(_BYTE_ENCODING), b"\n")
    return data, count


def _separator(header: _TextHeader) -> str:
    line = header.first
    words, fields = line.split(), [field.split() for field in line.rstrip().split("\t")]
    if ";" in line:
        return ";"
    if any(_has_all_names(title, line.count("\t")) for title in header.titles):
        return "\t"
    if "," in line and not have_decimal_commas(words):
        return ","
    return "\t" if len(fields) > 1 and all(map(_is_one_value, fields)) else " "


def _has_all_names(title: str, tabs: int) -> bool:
    return title.count("\t") == tabs > 0 and all(map(str.strip, title.split("\t")))


def _is_one_value(words: Sequence[str]) -> bool:
    return len(words) == 1 or (bool(words) and not any(map(NUMBER.fullmatch, words)))


def _parsed(data: bytes, separator: str, decimal: str) -> list[NDArray[Any]]:
    import pyarrow as pa
    from pyarrow import csv as arrow

    if separator == " ":
        data = re.sub(rb"(?m)^ | $", b"", re.sub(rb"[ \t]+", b" ", data))
    elif b" \n" in data or data.endswith(b" "):
        data = re.sub(rb"(?m) +$", b"", data)
    block_size = min(len(data) + 1, _MAX_BLOCK_BYTES)  # Arrow infers types from the first block
    try:
        table = arrow.read_csv(
            io.BytesIO(data),
            arrow.ReadOptions(autogenerate_column_names=True, block_size=block_size),
            arrow.ParseOptions(delimiter=separator),
            arrow.ConvertOptions(decimal_point=decimal),
        )
    except pa.ArrowException as error:
        raise InputError(f"not a table of numbers ({one_line(error)})") from error
    empty = np.full(len(table), np.nan)
    return [empty if pa.types.is_null(each.type) else each.to_numpy() for each in table.columns]


def _names(header: _TextHeader, separator: str, columns: Sequence[NDArray[Any]]) -> list[str]:
    lines = header.titles or list(filter(_has_names, header.comments[-_MAX_COMMENTS:]))
    candidates = [names for line in lines if (names := _matching_names(line, separator, columns))]
    if lines and not candidates:
        count = len(_split(lines[-1], separator))
        hint = ": do commas separate decimals, too?" if len(columns) == 2 * count else ""
        line = _real(lines[-1])[:60]
        raise InputError(f"{count} names ({line!r}) for {len(columns)} columns{hint}")
    default = candidates[-1] if candidates else []
    names = next(filter(has_coordinates, reversed(candidates)), default)
    for name, count in Counter(map(str.lower, filter(None, names))).items():
        if count > 1:
            raise InputError(f"two columns are named {name}")
    return names


def _has_names(comment: str) -> bool:
    return any(has_coordinates(_split(comment, separator)) for separator in _SEPARATORS)


def _matching_names(line: str, separator: str, columns: Sequence[NDArray[Any]]) -> list[str]:
    splits = [_split(line, each) for each in (separator, *_SEPARATORS)]
    matching = [
        names
        for names in splits
        if len(names) <= len(columns) and all(map(_is_empty, columns[len(names) :]))
    ]
    return next(filter(has_coordinates, matching), matching[0] if matching else [])


def _split(line: str, separator: str) -> list[str]:
    line = " ".join(line.split()) if separator == " " else line
    try:
        names = next(csv.reader([_real(line).strip(" \n")], delimiter=separator), [])
    except csv.Error:  # a field of over 128 KiB
        return []
    names = [name.strip(" \t\"'") for name in names]
    while names and not names[-1]:
        names.pop()
    return names


def _with_default_names(
    columns: list[NDArray[Any]], first: str, separator: str, path: Path
) -> tuple[list[str], list[NDArray[Any]]]:
    while columns and _is_empty(columns[-1]):
        columns = columns[:-1]
    if len(columns) < MIN_NUMBERS or not all(each.dtype.kind in "fiu" for each in columns):
        raise _no_table(first)
    if separator == "," and all(each.dtype.kind in "iu" for each in columns):
        check_six_numbers((each.min(), each.max()) for each in columns)
    points = _without_pandas_header(columns)
    if points is not columns:
        _log.warning("%s: its first line numbers the columns, and is not a point", path)
    if _counts_points(points):
        raise InputError("its first column counts the points: name the columns in its first line")
    return list(default_columns(np.column_stack(points))), points


def _without_pandas_header(columns: list[NDArray[Any]]) -> list[NDArray[Any]]:
    first = [float(each[0]) for each in columns]
    has_index = bool(np.isnan(first[0])) and len(columns) > MIN_NUMBERS
    if first[has_index:] != [*map(float, range(len(columns) - has_index))]:
        return columns
    is_integer = all((each == np.rint(each)).all() for each in columns)
    return columns if is_integer and not has_index else [each[1:] for each in columns[has_index:]]


def _counts_points(columns: list[NDArray[Any]]) -> bool:
    first, second = columns[:2]
    return (
        len(columns) > MIN_NUMBERS < len(first)
        and bool((np.diff(first) == 1).all() and (first == np.rint(first)).all())
        and bool((second != np.rint(second)).any())
    )


def _is_empty(column: NDArray[Any]) -> bool:
    return column.dtype.kind == "f" and bool(np.isnan(column).all())


def _numeric_columns(
    names: Sequence[str], columns: Sequence[NDArray[Any]], decimal: str, path: Path
) -> Columns:
    named = {name: column for name, column in zip(names, columns, strict=True) if name}
    numeric = {name: column for name, column in named.items() if column.dtype.kind in "fiu"}
    others = [name for name in named if name not in numeric]
    if has_coordinates(named) and not has_coordinates(numeric):
        raise InputError(f"not a table of numbers ({_first_word(others[0], named, decimal)})")
    if others:
        _log.warning("%s: columns without numbers are left out: %s", path, ", ".join(others))
    if rounded := [name for name, column in numeric.items() if _has_long_integers(column)]:
        _log.warning("%s: numbers from 2^53 on are rounded: %s", path, ", ".join(rounded))
    return numeric


def _first_word(name: str, columns: Columns, decimal: str) -> str:
    other = re.compile(rf"[-+]?\d*({re.escape(decimal)}\d*)?(e[-+]?\d+)?", re.IGNORECASE)
    texts = (str(text).strip() for text in columns[name])
    word = next((text for text in texts if not other.fullmatch(text)), "")
    return f"column {name} has {word!r}{fault_of_number(word, decimal)}"


def _has_long_integers(column: NDArray[Any]) -> bool:
    if column.dtype.kind != "f":
        return False
    finite = column[np.abs(column) < np.inf]
    return bool(np.abs(finite).max(initial=0) >= _EXACT_INTEGERS)

"""Numbers in text as spreadsheets, scanners and Fortran programs write them."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from pointkit.errors import InputError

NUMBER = re.compile(
    r"[-+]?(\d+[.,]?\d*|[.,]\d+)(e[-+]?\d+)?|[-+]?(\d+[.,]\d*|[.,]\d+)d[-+]?\d+"
    r"|[-+]?(nan(\(\w*\))?|inf(inity)?)|#?n/?a|null|[-+]?1\.#\w+",
    re.IGNORECASE | re.ASCII,
)
"""A number, or a word for a missing number, with a decimal point or comma."""
MIN_NUMBERS = 3
"""Minimum number of values in a point's line."""
_COMMA = re.compile(r"[-+]?\d+,\d+(e[-+]?\d+)?", re.IGNORECASE)
_POINTED = re.compile(r"[-+]?\d*\.\d+(e[-+]?\d+)?", re.IGNORECASE)
_GROUPED = re.compile(r"[-+]?[1-9]\d{0,2}([.,'\s]\d{3})+([.,]\d*)?")
"""A number whose thousands may be separated."""
_CUT_DECIMALS = re.compile(rb"(?m)\d,0\d+(,|$)")
"""A field with a leading zero, such as the decimals after a decimal comma."""
_FORTRAN = rb"([-+]?(?:\d+\.\d*|\.\d+))[dD]([-+]?\d+)"
_FORTRAN_FIELD = re.compile(rb"(?<![^\s,;\"'])" + _FORTRAN + rb"(?![^\s,;\"'])")
_log = logging.getLogger(__name__)
_SEMICOLONS = "commas separate its numbers and their decimals; separate by semicolons"


def _uneven_commas() -> re.Pattern[bytes]:
    """Return a pattern of three fields, one of which is two numbers with a comma between."""
    pair, field, apart = rb"[-+]?\d+,\d+", rb"[-+]?\d+(?:,\d+)?", rb",[ \t]+"
    orders = [[pair, field, field], [field, pair, field], [field, field, pair]]
    lines = b"|".join(apart.join(order) for order in orders)
    return re.compile(rb"(?m)^[ \t]*(?:" + lines + rb")(?=,?[ \t]|,?$)")


_UNEVEN_COMMAS = _uneven_commas()


def have_decimal_commas(words: Sequence[str]) -> bool:
    """Return whether the words of a line, which are separated by blanks, have decimal commas."""
    commas = [word.strip("\"'") for word in words if "," in word]
    return len(words) >= MIN_NUMBERS and bool(commas) and all(map(_COMMA.fullmatch, commas))


def check_comma_separated(lines: bytes) -> None:
    """Raise InputError if, in lines of points, commas separate both numbers and their decimals."""
    if b"." not in lines and (_CUT_DECIMALS.search(lines) or _UNEVEN_COMMAS.search(lines)):
        raise InputError(_SEMICOLONS)


def check_six_numbers(columns: Iterable[tuple[float, float]]) -> None:
    """Raise InputError if six columns of integers may be three columns with decimal commas.

    They are refused if every second column, which would hold the decimals, has only the numbers 0
    to 9.

    Parameters
    ----------
    columns
        Least and greatest number of each column.
    """
    ranges = list(columns)
    if len(ranges) == 2 * MIN_NUMBERS and all(0 <= low <= high <= 9 for low, high in ranges[1::2]):
        raise InputError(f"six numbers, or three? If {_SEMICOLONS}; else name its columns")


def with_e_exponents(lines: bytes, first: str) -> bytes:
    """Return lines of points with Fortran's exponents (1.0D+00) changed to those with an e.

    Parameters
    ----------
    lines
        Lines of points.
    first
        Line of the first point. If it has no such exponent, `lines` are returned unchanged.
    """
    if not _FORTRAN_FIELD.search(first.encode("latin-1")):
        return lines
    return _FORTRAN_FIELD.sub(rb"\1e\2", lines)


def decimal_sign(lines: bytes, separator: str, path: Path) -> str:
    """Return the sign that precedes decimals in lines of points: a comma or a point.

    Parameters
    ----------
    lines
        Lines of points.
    separator
        Sign between the fields of a line. If it is a comma, only numbers in quotes can have decimal
        commas.
    path
        The file that messages name. If commas could also separate thousands, they are taken as
        decimal commas with a warning; in fields with quotes, they raise InputError.
    """
    needed = b'"' if separator == "," else b","
    first = next(_with_commas(lines, separator), None) if needed in lines else None
    if first is None:
        return "."
    if all(_GROUPED.fullmatch(each[2].decode()) for each in _with_commas(lines, separator)):
        number = first[2].decode()
        whole, point = number.replace(",", ""), number.replace(",", ".")
        if first[1]:
            raise InputError(f"'{number}' may be {whole} or {point}: write it so")
        _log.warning("%s: its commas are read as decimal commas: %s is %s", path, number, point)
    return ","


def _with_commas(lines: bytes, separator: str) -> Iterator[re.Match[bytes]]:
    """Yield the fields with one comma; if commas separate fields, only those in quotes."""
    quote = rb'"' if separator == "," else rb'"?'
    edge = rb"[ \t]" if separator in " \t" else re.escape(separator.encode())
    number = rb"([-+]?\d*,\d+(?:[eE][-+]?\d+)?)"
    field = rb"(?m)(?:^|" + edge + rb") *(" + quote + rb")" + number + rb"\1 *(?=" + edge + rb"|$)"
    return re.finditer(field, lines)


def fault_of_number(text: str, decimal: str) -> str:
    """Return the end of an error message that says why a text is not quite a number.

    It is empty if nothing particular is wrong. `decimal` is the sign before the decimals of the
    other numbers.
    """
    if (_POINTED if decimal == "," else _COMMA).fullmatch(text):
        return ", but other decimals follow " + ("commas" if decimal == "," else "points")
    if _GROUPED.fullmatch(text):
        return ": write numbers without separators of thousands"
    return ""

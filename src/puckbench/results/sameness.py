"""Whether two runs have the same results, apart from times, memory and the machine."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Collection, Mapping
from math import isfinite

from puckbench.results.columns import column_named

_MEMORY = re.compile(r"(en|de)code_peak_mib(_\w+)?")
_OF_MACHINE = ("cpu", "encode_cpu", "threads", "libraries", "puckbench_version")
"""Columns that tell the machine and the software."""
_MOST_COLUMNS = 4
Timed = Mapping[str, Collection[str]]
"""What of a table depends on times, by name of the column: texts whose rows do, or, if there are
none, the whole column."""


def is_timed(column: str) -> bool:
    """Return whether a column has times or memory, which differ each time they are measured."""
    return column_named(column).timed or _MEMORY.fullmatch(column) is not None


def timeless(rows: list[list[str]], timed: Timed) -> list[list[str]]:
    """Return the rows of a table, of which the first has the names, without what is timed."""
    names, *others = rows or [[]]
    kept = [
        place for place, name in enumerate(names) if not is_timed(name) and timed.get(name, ("",))
    ]
    marks = [(names.index(name), texts) for name, texts in timed.items() if name in names]
    rest = [row for row in others if not any(row[at] in texts for at, texts in marks)]
    return [[row[place] for place in kept] for row in (names, *rest)]


def table_difference(first: bytes, second: bytes, timed: Timed) -> str:
    """Return in words how two tables differ, apart from times, memory and the machine.

    Parameters
    ----------
    first, second
        Contents of two CSV files.
    timed
        What else of the tables depends on times.

    Returns
    -------
    str
        The difference, or an empty text if there is none.
    """
    (names, *rows), (other_names, *other_rows) = (
        _without_machine(timeless(_rows(data), timed)) for data in (first, second)
    )
    if names != other_names:
        odd = [name for name in (*names, *other_names) if (name in names) != (name in other_names)]
        return f"other columns: {_listed(odd)}" if odd else "another order of the columns"
    if len(rows) != len(other_rows):
        return f"{len(rows)} and {len(other_rows)} rows"
    found = []
    for place, name in enumerate(names):
        pairs = [(a[place], b[place]) for a, b in zip(rows, other_rows, strict=True)]
        odd_pairs = [pair for pair in pairs if pair[0] != pair[1]]
        if odd_pairs:
            found.append(f"{name} in {len(odd_pairs)} of {len(rows)} rows{_at_most(odd_pairs)}")
    return _listed(found)


def _rows(data: bytes) -> list[list[str]]:
    rows = list(csv.reader(io.StringIO(data.decode(errors="replace"), newline="")))
    width = len(rows[0]) if rows else 0
    return [(row + [""] * width)[:width] for row in rows]


def _without_machine(rows: list[list[str]]) -> list[list[str]]:
    kept = [place for place, name in enumerate(rows[0]) if name not in _OF_MACHINE]
    return [[row[place] for place in kept] for row in rows]


def _at_most(pairs: Collection[tuple[str, str]]) -> str:
    """Return the largest relative difference of pairs of numbers in words, if they are numbers."""
    try:
        numbers = [(float(a), float(b)) for a, b in pairs]
    except ValueError:
        return ""
    ratios = [abs(a - b) / max(abs(a), abs(b)) for a, b in numbers if a != b]
    return (
        f" (by at most {max(ratios, default=0.0):.1g} of the value)"
        if all(map(isfinite, ratios))
        else ""
    )


def _listed(texts: Collection[str]) -> str:
    shown = list(texts)[:_MOST_COLUMNS]
    more = f" and {len(texts) - len(shown)} more" if len(texts) > len(shown) else ""
    return ", ".join(shown) + more

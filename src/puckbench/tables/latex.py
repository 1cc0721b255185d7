"""Conversion of tables of results to LaTeX, for papers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from math import isnan
from typing import TYPE_CHECKING, Any

from pointkit.errors import InputError, among, closest
from puckbench.metrics.coordinate_frames import frames_of
from puckbench.metrics.statistics import MIN_SCENES
from puckbench.results.columns import column_named, is_declared, unit_in_frames
from puckbench.tables.cells import cell_text, decimals_of, is_bookkeeping

if TYPE_CHECKING:
    import pandas as pd

_SPECIAL = re.compile(r"[&%$#_{}]")
_REPLACED = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "²": r"\textsuperscript{2}", "°": r"\textdegree{}", "−": "$-$", "\N{NO-BREAK SPACE}": "~",
}  # fmt: skip
MOST_COLUMNS = 8
"""Largest number of columns, intervals not counted, that fit on a page."""
_ENDS_OF_OTHERS = {"difference": ("low", "high"), "loss": ("low", "high")}
"""Columns whose interval is in columns with names of their own."""
_COUNTS = ("scenes", "trajectories", "clouds")
"""Columns that count what values and intervals are over; of several, the first counts."""
_CODECS = ("codec", "anchor")
"""Columns whose values are names of codecs, for which a table shows the codecs' titles."""
_NO_VALUE = "--"


def paper_columns(
    table: pd.DataFrame, wanted: Sequence[str] = (), usual: Sequence[str] = ()
) -> list[str]:
    """Return the columns of a table of results that a paper shows.

    Parameters
    ----------
    table
        The table.
    wanted
        Names of the columns, at most `MOST_COLUMNS`. A column's interval (``NAME_low`` and
        ``NAME_high``) is shown with it, and need not be named.
    usual
        Names of the columns that are taken if `wanted` is empty, as far as they have values. By
        default, they are the first `MOST_COLUMNS`, but for columns that are empty, are part of an
        interval, or tell how values were obtained.

    Raises
    ------
    InputError
        A column does not exist or is named twice, or there are too many.
    """
    names = [str(name) for name in table]
    for name in wanted:
        if name not in names:
            raise InputError(f"no column '{name}'{closest(name, names) or among(name, names)}")
        if wanted.count(name) > 1:
            raise InputError(f"column '{name}' is named twice")
    if len(wanted) > MOST_COLUMNS:
        raise InputError(f"{len(wanted)} columns, but a page has space for {MOST_COLUMNS}")
    if wanted:
        return list(wanted)
    ends = {end for name in names for end in interval_ends(name, names) or ()}
    full = [name for name in names if not is_bookkeeping(table[name]) and name not in ends]
    return [name for name in usual or full if name in full][:MOST_COLUMNS]


def interval_ends(name: str, names: Sequence[str]) -> tuple[str, str] | None:
    """Return the names of the two columns with the interval of a column, or None."""
    ends = _ENDS_OF_OTHERS.get(name, (f"{name}_low", f"{name}_high"))
    return ends if {name, *ends} <= set(names) else None


def with_intervals(columns: Sequence[str], table: pd.DataFrame) -> list[str]:
    """Return columns of a table of results, each followed by those of its interval."""
    names = [str(name) for name in table]
    return [each for name in columns for each in (name, *(interval_ends(name, names) or ()))]


def latex_table(
    table: pd.DataFrame,
    columns: Sequence[str] | None = None,
    titles: Mapping[str, str] | None = None,
) -> str:
    r"""Return a table of results as a LaTeX ``tabular`` with a note, for the package booktabs.

    Headings are the columns' short names, with units. A value is followed by its 95 % interval if
    the table has one: ``$-12.3\ [-14.1, -10.5]$``. All three have so many digits that half the
    interval's width has two. Other values have the digits that their column declares. Missing
    values are dashes. The note below the table says what intervals are over, and how many.

    Parameters
    ----------
    table
        The table.
    columns
        Names of the columns; by default, those of `paper_columns`.
    titles
        Titles of codecs, which replace their names.
    """
    import pandas as pd

    columns = paper_columns(table) if columns is None else columns
    frames, names = frames_of(table), [str(name) for name in table]
    heads = [_escaped(_heading(name, names, frames)) for name in columns]
    alignment = "".join("r" if table[name].dtype.kind in "fiu" else "l" for name in columns)
    rows = table.to_dict("records")
    cells = [[_cell(row, name, titles or {}) for name in columns] for row in rows]
    text = pd.DataFrame(cells, columns=heads).to_latex(index=False, column_format=alignment)
    note = _escaped(" ".join(_note(table, columns)))
    return f"{text}\n{{\\footnotesize\\raggedright {note}\\par}}\n" if note else text


def _heading(name: str, names: Sequence[str], frames: Any) -> str:
    column = column_named(name, names)
    unit = unit_in_frames(column.unit, frames)
    return f"{column.short_words} ({unit})" if unit else column.short_words


def _cell(row: Mapping[Any, Any], name: str, titles: Mapping[str, str]) -> str:
    value = row[name]
    if isinstance(value, str):
        return _escaped(_title(name, value, titles))
    if not isinstance(value, int | float) or isinstance(value, bool) or isnan(value):
        return _escaped(cell_text(value)) or _NO_VALUE
    ends = [row[end] for end in interval_ends(name, list(row)) or ()]
    if ends and not any(map(isnan, ends)) and ends[0] < ends[1]:
        decimals = decimals_of((ends[1] - ends[0]) / 2)
        low, high = (_rounded(end, decimals) for end in ends)
        return rf"${_rounded(value, decimals)}\ [{low}, {high}]$"
    text = _number(value, name)
    return f"${text}$" if text.startswith("-") or "^" in text else text


def _title(name: str, value: str, titles: Mapping[str, str]) -> str:
    """Return how a text is shown: codecs by their titles, and columns by their short names."""
    if name in _CODECS:
        return titles.get(value, value)
    return column_named(value).short_words if name == "metric" and is_declared(value) else value


def _rounded(value: float, decimals: int) -> str:
    return f"{round(value, decimals) + 0.0:.{max(0, decimals)}f}"  # + 0.0: no negative zero


def _number(value: float, name: str) -> str:
    column = column_named(name)
    if isinstance(value, int) or column.counts:
        return f"{value:.0f}"
    if column.decimals is not None:
        return _rounded(value, column.decimals)
    text = f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    digits, _, exponent = text.partition("e")
    return rf"{digits} \times 10^{{{int(exponent)}}}" if exponent else text


def _note(table: pd.DataFrame, columns: Sequence[str]) -> Iterator[str]:
    """Yield sentences on the intervals of the columns, and on what values are over."""
    names = [str(name) for name in table]
    ends = {name: pair for name in columns if (pair := interval_ends(name, names))}
    over = next((name for name in _COUNTS if name in names), None)
    if ends:
        rows = table[table[list(ends)].notna().any(axis=1)]
        over_what = f" over {over} (n = {_range_text(rows[over])})" if over and len(rows) else ""
        yield f"In brackets: 95 % interval{over_what}."
        if any((rows[name].notna() & rows[low].isna()).any() for name, (low, _) in ends.items()):
            yield f"There is none below n = {MIN_SCENES}."
    elif over is not None and over not in columns and len(table):
        yield f"n = {_range_text(table[over])} {over}."


def _range_text(counts: pd.Series[Any]) -> str:
    low, high = (f"{end:.0f}" for end in (counts.min(), counts.max()))
    return low if low == high else f"{low} to {high}"


def _escaped(text: str) -> str:
    escaped = _SPECIAL.sub(lambda match: "\\" + match[0], text.replace("\\", "\0"))
    for character, command in _REPLACED.items():
        escaped = escaped.replace("\0" if character == "\\" else character, command)
    return escaped

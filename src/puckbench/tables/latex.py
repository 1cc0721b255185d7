"""Conversion of tables of results to LaTeX."""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import isnan, nan
from typing import TYPE_CHECKING, Any

from puckbench.results.columns import column_named
from puckbench.tables.cells import cell_text, interval_text, is_bookkeeping

if TYPE_CHECKING:
    import pandas as pd

_SPECIAL = re.compile(r"[&%$#_{}]")
_REPLACED = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "²": r"\textsuperscript{2}", "°": r"\textdegree{}", "−": "$-$", "\N{NO-BREAK SPACE}": "~",
}  # fmt: skip
MOST_COLUMNS = 12
_ENDS = ("_low", "_high")


def latex_table(table: pd.DataFrame) -> str:
    """Return a table of results as a LaTeX ``tabular``, which needs the package booktabs.

    Headings are the columns' names in words, with units. If the table has columns ``NAME_low`` and
    ``NAME_high`` beside ``NAME``, the value is followed by this interval, and has as many digits as
    the interval allows. Other numbers have three significant digits, and missing values are dashes.
    At most twelve columns are written. Empty columns are left out, and so are columns that tell how
    values were obtained.
    """
    import pandas as pd

    names = [str(name) for name in table if not is_bookkeeping(table[name])]
    ends = {f"{name}{end}" for name in names for end in _ENDS}
    names = [name for name in names if name not in ends][:MOST_COLUMNS]
    heads = [_escaped(column_named(name, names).label) for name in names]
    alignment = "".join("r" if table[name].dtype.kind in "fiu" else "l" for name in names)
    rows = table.to_dict("records")
    cells = [[_escaped(_cell(row, name) or "--") for name in names] for row in rows]
    return pd.DataFrame(cells, columns=heads).to_latex(index=False, column_format=alignment)


def _cell(row: Mapping[Any, Any], name: str) -> str:
    value, (low, high) = row[name], (row.get(f"{name}{end}", nan) for end in _ENDS)
    if not isinstance(value, float):
        return cell_text(value)
    if isnan(value):
        return ""
    if not (isnan(low) or isnan(high) or low == high):
        return interval_text(value, low, high)
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _escaped(text: str) -> str:
    escaped = _SPECIAL.sub(lambda match: "\\" + match[0], text.replace("\\", "\0"))
    for character, command in _REPLACED.items():
        escaped = escaped.replace("\0" if character == "\\" else character, command)
    return escaped

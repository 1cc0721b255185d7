"""Tables of results as HTML, which the page's script makes sortable and filterable."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.report.markup import Markup, joined, tag
from puckbench.report.quantities import measured

if TYPE_CHECKING:
    import pandas as pd

MOST_ROWS = 1000
"""Rows of a table that stand in the page; the file has all of them."""
_SPREAD = re.compile(r"(.+)_(q05|q25|q75|q95)")
_UNITS = {"_m": "m", "_rad": "rad", "_deg": "°", "_percent": "%", "_db": "dB", "_s": "s"}


def table_html(table: pd.DataFrame, link: str | None = None) -> Markup:
    """The table, and how many of its rows are left out; `link` leads to the whole file.

    Columns of quantiles beside their median get the class ``spread``, columns of numbers the class
    ``number``.
    """
    columns = [str(name) for name in table]
    classes = [_class(table[name], columns) for name in table]
    heads = [_head(name, kind) for name, kind in zip(columns, classes, strict=True)]
    rows = (_row(row, classes) for row in table.head(MOST_ROWS).itertuples(index=False))
    body = tag("table", tag("thead", tag("tr", *heads)), tag("tbody", joined(rows)), class_="data")
    return joined([tag("div", body, class_="scroll", tabindex=0), _below(len(table), link)])


def _class(values: pd.Series[Any], columns: list[str]) -> str | None:
    quantile = _SPREAD.fullmatch(str(values.name))
    kinds = ["number"] if values.dtype.kind in "fiu" else []
    kinds += ["spread"] if quantile and quantile[1] in columns else []
    return " ".join(kinds) or None


def _head(column: str, kind: str | None) -> Markup:
    quantile = _SPREAD.fullmatch(column)
    known = measured(quantile[1] if quantile else column)
    unit = known.unit or next((_UNITS[end] for end in _UNITS if column.endswith(end)), "")
    words = known.words if known.words != column else None
    return tag("th", column, tag("small", unit), scope="col", title=words, class_=kind)


def _row(values: tuple[Any, ...], classes: list[str | None]) -> Markup:
    cells = (tag("td", text_of(v), class_=kind) for v, kind in zip(values, classes, strict=True))
    return tag("tr", *cells)


def text_of(value: Any) -> str:
    """A cell's text: numbers to four significant digits, nothing for a missing one."""
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return str(value)
    if isinstance(value, float | np.floating):
        return "" if np.isnan(value) else _number_text(float(value))
    return "" if value is None or value is _missing() else str(value)


def _number_text(value: float) -> str:
    return f"{value:.0f}" if 1e4 <= abs(value) < 1e12 else f"{value:.4g}"


def _missing() -> Any:
    import pandas as pd

    return pd.NA


def _below(rows: int, link: str | None) -> Markup:
    parts: list[Markup | str] = []
    if rows > MOST_ROWS:
        parts.append(f"The first {MOST_ROWS:,} of {rows:,} rows. ")
    if link:
        parts += ["All digits: ", tag("a", link, href=link), ", if it lies beside this page."]
    return tag("p", *parts, class_="below") if parts else Markup("")

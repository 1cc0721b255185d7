"""Tables of results as HTML, which the page's script makes sortable and filterable."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.report.page import rendered
from puckbench.report.quantities import measured

if TYPE_CHECKING:
    import pandas as pd
    from markupsafe import Markup

MOST_ROWS = 1000
"""Rows of a table that stand in the page; the file has all of them."""
_SPREAD = re.compile(r"(.+)_(q05|q25|q75|q95)")
_UNITS = {"_m": "m", "_rad": "rad", "_deg": "°", "_percent": "%", "_db": "dB", "_s": "s"}


@dataclass(frozen=True)
class Column:
    """A column of a table in the page.

    Parameters
    ----------
    name
        As in the file.
    words, unit
        What it measures, where there are words and a unit for it.
    kind
        Classes: ``number``, and ``spread`` for a quantile beside its median.
    """

    name: str
    words: str
    unit: str
    kind: str


def table_html(table: pd.DataFrame, link: str | None = None) -> Markup:
    """A table as HTML, with how many rows are left out; `link` leads to the whole file."""
    from markupsafe import Markup

    values = {
        "columns": _columns(table),
        "rows": [[text_of(value) for value in row] for row in _first_rows(table)],
        "total": len(table),
        "most": MOST_ROWS,
        "link": link,
    }
    return Markup(rendered("table.html", **values))  # noqa: S704


def _first_rows(table: pd.DataFrame) -> Any:
    return table.head(MOST_ROWS).itertuples(index=False)


def _columns(table: pd.DataFrame) -> list[Column]:
    names = [str(name) for name in table]
    return [_column(table[name], names) for name in table]


def _column(values: pd.Series[Any], names: list[str]) -> Column:
    name = str(values.name)
    quantile = _SPREAD.fullmatch(name)
    kinds = ["number"] if values.dtype.kind in "fiu" else []
    kinds += ["spread"] if quantile and quantile[1] in names else []
    known = measured(quantile[1] if quantile else name)
    unit = known.unit or next((_UNITS[end] for end in _UNITS if name.endswith(end)), "")
    return Column(name, known.words if known.words != name else "", unit, " ".join(kinds))


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

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from puckbench.figures.style import FigureStyle
from puckbench.metrics.coordinate_frames import frames_of
from puckbench.report.cells import cell_text
from puckbench.report.column_labels import has_label, table_heading, unit_in_frames
from puckbench.report.page import rendered

if TYPE_CHECKING:
    import pandas as pd
    from markupsafe import Markup

MOST_ROWS = 1000
"""Largest number of rows of a table in the page; the linked file has all rows."""
_SPREAD = re.compile(r"(.+)_(q25|q75)")
_BOOKKEEPING = re.compile(
    "clouds|compared|no_common_range|too_few_points|quality_compared|shared_range|(anchor_)?pooled"
    "|little_overlap|anchor_lossless|anchor_points|bd_(rate|quality)_status|log_ratio"
    "|truth_points_[ab]"
    "|group|count|scans|weights|digest|(truth_|clean_)?acd_.*"
)
"""Columns that tell how values were obtained. Like empty columns, they come last and are hidden."""


@dataclass(frozen=True)
class TableColumn:
    """A column of a table in the page.

    Parameters
    ----------
    name
        Name of the column.
    words, unit
        Heading of the column.
    kind
        CSS classes: ``number``; ``spread`` for a quantile beside a median; ``bookkeeping`` for a
        column that tells how values were obtained.
    """

    name: str
    words: str
    unit: str
    kind: str


def table_html(
    table: pd.DataFrame, link: str | None = None, style: FigureStyle | None = None
) -> Markup:
    """Return a table as HTML.

    Parameters
    ----------
    table
        The table, of which at most `MOST_ROWS` rows are shown.
    link
        Link to a file with the whole table.
    style
        Style of the figures, for titles of data sets and codecs.
    """
    from markupsafe import Markup

    ordered = table[_in_order(table)]
    titles = [_titles(str(name), style or FigureStyle()) for name in ordered]
    frames = frames_of(table)
    values = {
        "columns": [_column(ordered[name], list(map(str, table)), frames) for name in ordered],
        "rows": [
            [title(cell_text(value)) for title, value in zip(titles, row, strict=True)]
            for row in ordered.head(MOST_ROWS).itertuples(index=False)
        ],
        "total": len(table),
        "most": MOST_ROWS,
        "link": link,
    }
    return Markup(rendered("table.html", **values))  # noqa: S704


def _in_order(table: pd.DataFrame) -> list[str]:
    names = [str(name) for name in table]
    last = [name for name in names if is_bookkeeping(table[name])]
    return [name for name in names if name not in last] + last


def is_bookkeeping(values: pd.Series[Any]) -> bool:
    """Return whether a column is empty, or tells only how other values were obtained."""
    return bool(_BOOKKEEPING.fullmatch(str(values.name))) or bool(values.isna().all())


def _titles(column: str, style: FigureStyle) -> Callable[[str], str]:
    from virtual_lidar.errors import error_model_title

    titles: dict[str, Callable[[str], str]] = {
        "dataset": style.title,
        "codec": lambda name: style.of_codec(name).title,
        "anchor": lambda name: style.of_codec(name).title,
        "metric": lambda name: table_heading(name)[0],
        "quantity": _quantity_title,
        "model": error_model_title,
    }
    return titles.get(column, str)


def _quantity_title(name: str) -> str:
    return table_heading(name)[0] if has_label(name) else name


def _column(values: pd.Series[Any], names: list[str], frames: Collection[str]) -> TableColumn:
    name = str(values.name)
    quantile = _SPREAD.fullmatch(name)
    kinds = ["number"] if values.dtype.kind in "fiu" else []
    kinds += ["spread"] if quantile and quantile[1] in names else []
    kinds += ["bookkeeping"] if is_bookkeeping(values) else []
    words, unit = table_heading(name, names)
    return TableColumn(name, words, unit_in_frames(unit, frames), " ".join(kinds))

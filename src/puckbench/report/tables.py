from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from puckbench.figures.style import FigureStyle
from puckbench.metrics.coordinate_frames import frames_of
from puckbench.report.page import rendered
from puckbench.results.columns import column_named, is_declared, is_spread, unit_in_frames
from puckbench.tables.cells import cell_text, is_bookkeeping

if TYPE_CHECKING:
    import pandas as pd
    from markupsafe import Markup

MOST_ROWS = 1000
"""Largest number of rows of a table in the page; the linked file has all rows."""


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


def _titles(name: str, style: FigureStyle) -> Callable[[str], str]:
    from virtual_lidar.errors import error_model_title

    titles: dict[str, Callable[[str], str]] = {
        "dataset": style.title,
        "codec": lambda codec: style.of_codec(codec).title,
        "anchor": lambda codec: style.of_codec(codec).title,
        "metric": lambda metric: column_named(metric).short_words,
        "quantity": _quantity_title,
        "model": error_model_title,
    }
    return titles.get(name, str)


def _quantity_title(name: str) -> str:
    return column_named(name).words if is_declared(name) else name


def _column(values: pd.Series[Any], names: list[str], frames: Collection[str]) -> TableColumn:
    name = str(values.name)
    kinds = ["number"] if values.dtype.kind in "fiu" else []
    kinds += ["spread"] if is_spread(name, names) else []
    kinds += ["bookkeeping"] if is_bookkeeping(values) else []
    described = column_named(name, names)
    unit = unit_in_frames(described.unit, frames)
    return TableColumn(name, described.words, unit, " ".join(kinds))

"""Curves of a run and published ones as rows of text, with their conditions side by side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.published_sources.beside import count_text, curves_of, marks_of
from puckbench.published_sources.rows import NONE
from puckbench.results.columns import column_named

if TYPE_CHECKING:
    import pandas as pd

HEADS = (
    *("codec", "from", "cloud", "bits per point", "value", "peak", "points", "frames"),
    *("coordinates", "machine", ""),
)
"""Headings of the rows of `tables_of_curves`; the last column has the marks."""


def tables_of_curves(points: pd.DataFrame) -> dict[str, list[list[str]]]:
    """Return a row of texts (`HEADS`) for each curve, by the title of its data set and metric.

    Parameters
    ----------
    points
        Table of `puckbench.published_sources.beside.beside_published`, also as read from a file.
    """
    marks = marks_of(points)
    tables: dict[str, list[list[str]]] = {}
    for curve, rows in curves_of(points):
        shown = column_named(curve["metric"])
        title = f"{curve['dataset']} beside {curve['published_as']}: {shown.short_words}"
        title += f" ({shown.unit})" if shown.unit else ""
        tables.setdefault(title, []).append(_cells(curve, rows, marks))
    return tables


def _cells(curve: Mapping[str, Any], rows: pd.DataFrame, marks: Mapping[str, str]) -> list[str]:
    version = curve["codec_version"]
    return [
        f"{curve['codec']}, {version}",
        curve["origin"],
        curve["cloud"],
        _range(rows["bpp"]),
        _range(rows["measured"]),
        _known(curve["peak"]),
        count_text(float(curve["points"])),
        count_text(float(curve["frames"])),
        curve["resolution"],
        _known(curve["machine"]),
        marks.get(curve["differs"], ""),
    ]


def _known(condition: object) -> str:
    return "" if condition == NONE else str(condition)


def _range(values: pd.Series[Any]) -> str:
    """Return the least and the greatest finite value, and whether there are infinite ones."""
    numbers = values.to_numpy(float)
    finite = numbers[np.isfinite(numbers)]
    ends = dict.fromkeys([finite.min(), finite.max()]) if len(finite) else {}
    lossless = "lossless" if np.isinf(numbers).any() else ""
    return ", ".join(filter(None, [" to ".join(f"{value:.4g}" for value in ends), lossless]))

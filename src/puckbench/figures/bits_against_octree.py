"""The figure ``handicap``: bits of codecs for a sensor's data, relative to G-PCC's octree coder."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import (
    add_legend,
    label_outer,
    panel_grid,
    panels_abreast,
    set_log,
    set_title,
)
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle
from puckbench.metrics.table_registry import OCTREE_AND_OTHERS, SPINS_OR_RECORDINGS
from puckbench.metrics.tables.against_octree import (
    COMPLETE_OCTREE,
    GRIDS_MM,
    OCTREE,
    bits_without_loss,
)
from puckbench.metrics.tables.storage import bits_at_error

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from puckbench.geometry.cloud import Floats

_LEARNED = (85.0, 90.0)
"""Published bits of learned codecs for LiDAR, percent of the octree coder's."""
_ERRORS_MM = np.geomspace(0.5, 50, 61)
_MARKED = slice(None, None, 10)
_LIMITS_MM, _LIMITS = (0.35, 70.0), (15.0, 250.0)
_TICKS_MM, _TICKS = (0.5, 1, 2, 5, 10, 20, 50), (20, 50, 100, 200)
_PANEL_IN = 2.1


@FIGURES.register(
    "handicap",
    title="Bits relative to G-PCC's octree coder at equal error",
    category="Spins of a sensor",
    needs=(SPINS_OR_RECORDINGS, OCTREE_AND_OTHERS),
    frame="metric",
)
def draw_bits_against_octree(
    metrics: pd.DataFrame, clouds: pd.DataFrame, style: FigureStyle
) -> Figure:
    """Bits of each codec relative to G-PCC's octree coder (``gpcc``, without the sensor, 100 %) at
    equal D1 root mean square error. Lines: medians over clouds, where both codecs' rates reach the
    error.

    Hollow markers: every point coded losslessly on grids of 2 and 1 mm, at the error of rounding to
    the grid. Shaded: the savings of 10 to 15 % that papers on learned codecs report. Values outside
    the axes are not shown. Of data sets that differ only in the error model the first is shown.
    """
    from matplotlib.ticker import FixedLocator, PercentFormatter, StrMethodFormatter

    columns = ("dataset", "cloud", "codec", "rate", "bpp", "d1_rms_m", "points_in", "points_out")
    require_rows(metrics, columns, "metrics")
    require_numbers(metrics, ("bpp", "d1_rms_m"), "metrics")
    rows_mm = metrics.assign(error_mm=1000 * metrics["d1_rms_m"])
    datasets = [
        name
        for name in style.ordered_datasets(rows_mm["dataset"])
        if name in compared_datasets(rows_mm, clouds)
    ]
    if not datasets:
        raise InputError(f"metrics table: no data set is coded by {OCTREE} and by another codec")
    abreast = panels_abreast(len(datasets))
    figure, panels = panel_grid(len(datasets), abreast, _PANEL_IN, style)
    shown_codecs: set[str] = set()
    for axes, dataset in zip(panels, datasets, strict=True):
        set_log(axes, "x", _LIMITS_MM)
        set_log(axes, "y", _LIMITS, minor=False)
        axes.xaxis.set_major_locator(FixedLocator(_TICKS_MM))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_major_locator(FixedLocator(_TICKS))
        axes.yaxis.set_major_formatter(PercentFormatter(decimals=0))
        axes.axhspan(*_LEARNED, color="#cfcfcf", zorder=1, linewidth=0)
        axes.axhline(100, color=style.of_codec(OCTREE).colour, zorder=2, linewidth=1)
        rows = rows_mm[rows_mm["dataset"] == dataset]
        shown_codecs |= _draw_codecs(axes, rows, style)
        set_title(axes, style.title(dataset), abreast, style)
    label_outer(
        panels, abreast, "RMS error to the scan, D1 (mm)", "Bits, relative to\nG-PCC's octree coder"
    )
    add_legend(figure, style.ordered_codecs(shown_codecs), style, _extra_handles(style))
    return figure


def compared_datasets(metrics: pd.DataFrame, clouds: pd.DataFrame) -> set[str]:
    """Return the data sets with results of the octree coder and another codec; of those that differ
    only in the error model, the first.
    """
    other_rows = metrics[metrics["codec"] != OCTREE]
    datasets = set(metrics[metrics["codec"] == OCTREE]["dataset"]) & set(other_rows["dataset"])
    compared = clouds[clouds["dataset"].isin(datasets)]
    scan_columns = [name for name in ("cloud", "sensor", "turns", "firings") if name in compared]
    first = compared.groupby(scan_columns, dropna=False)["dataset"].transform("first")
    return set(first)


def _draw_codecs(axes: Axes, rows: pd.DataFrame, style: FigureStyle) -> set[str]:
    octree = rows[rows["codec"] == OCTREE]
    complete = rows[rows["codec"] == COMPLETE_OCTREE]
    shown_codecs: set[str] = set()
    for codec in style.ordered_codecs(rows["codec"]):
        if codec == OCTREE:
            continue
        curve, grids = shares(rows[rows["codec"] == codec], octree, complete)
        plot_style = style.of_codec(codec)
        common: dict[str, Any] = {
            "color": plot_style.colour,
            "marker": plot_style.marker,
            "zorder": 3,
        }
        axes.plot(_ERRORS_MM, curve, color=plot_style.colour, linestyle=plot_style.line, zorder=3)
        axes.plot(_ERRORS_MM[_MARKED], curve[_MARKED], linestyle="", **common)
        rounding_errors = np.asarray(GRIDS_MM) / 2
        axes.plot(rounding_errors, grids, linestyle="", markerfacecolor="white", **common)
        values = np.concatenate((curve, grids))
        if ((_LIMITS[0] <= values) & (values <= _LIMITS[1])).any():
            shown_codecs.add(codec)
    return shown_codecs


def shares(
    rows: pd.DataFrame, octree: pd.DataFrame, complete: pd.DataFrame
) -> tuple[Floats, Floats]:
    """Return a codec's bits in percent of the octree coder's, at errors from 0.5 to 50 mm and on
    lossless grids.

    `complete` contains the rows of the octree coder that keeps all duplicate points.
    """
    anchors = dict(iter(octree.groupby("cloud")))
    lossless = {**anchors, **dict(iter(complete.groupby("cloud")))}
    lines, grids = [], []
    for cloud, curve in rows.groupby("cloud"):
        if (anchor := anchors.get(cloud)) is None:
            continue
        lines.append(_bits_at_errors(curve) / _bits_at_errors(anchor))
        grids.append(_bits_on_grids(curve) / _bits_on_grids(lossless[cloud]))
    if not lines:
        return np.full(len(_ERRORS_MM), np.nan), np.full(len(GRIDS_MM), np.nan)
    return 100 * np.median(lines, axis=0), 100 * np.median(grids, axis=0)


def _bits_at_errors(curve: pd.DataFrame) -> Floats:
    bits = [bits_at_error(curve["bpp"], curve["error_mm"], mm) for mm in _ERRORS_MM.tolist()]
    return np.array(bits)


def _bits_on_grids(curve: pd.DataFrame) -> Floats:
    return np.array([bits_without_loss(curve, mm) for mm in GRIDS_MM])


def _extra_handles(style: FigureStyle) -> list[Artist]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    return [
        Line2D([], [], color=style.of_codec(OCTREE).colour, label="G-PCC's octree coder"),
        Patch(color="#cfcfcf", label="learned codecs, as published"),
        Line2D(
            [], [], linestyle="", marker="o", color="#444444", markerfacecolor="white",
            label="lossless on a grid",
        ),
    ]  # fmt: skip

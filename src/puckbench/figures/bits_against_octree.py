"""Bits of codecs of a sensor's data as a share of what G-PCC's octree needs."""

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
"""Percent of the octree's bits that learned codecs for LiDAR report."""
_ERRORS_MM = np.geomspace(0.5, 50, 61)
_MARKED = slice(None, None, 10)
_LIMITS_MM, _LIMITS = (0.35, 70.0), (15.0, 250.0)
_TICKS_MM, _TICKS = (0.5, 1, 2, 5, 10, 20, 50), (20, 50, 100, 200)
_PANEL_IN = 2.1


@FIGURES.register(
    "handicap",
    title="Bits beside those of G-PCC's octree, at equal error",
    category="Spins of a sensor",
    needs=(SPINS_OR_RECORDINGS, OCTREE_AND_OTHERS),
    frame="metric",
)
def draw_handicap(metrics: pd.DataFrame, clouds: pd.DataFrame, style: FigureStyle) -> Figure:
    """Bits as a share of what G-PCC's octree needs at the same root mean square error (D1), medians
    over the clouds; 100 % is ``gpcc``, the octree without the sensor.

    Hollow: every point, without loss on grids of 2 and 1 mm, at the error of rounding to them; a
    codec that gives back exactly what the sensor measured has no error. A line ends where no rate
    reaches; what lies outside of the axes, as codecs of many times the octree's bits do, is left
    out.
    Shaded: the 10 to 15 % that learned codecs report to save. Of data sets that differ in the
    sensor's errors alone the first is shown.
    """
    from matplotlib.ticker import FixedLocator, PercentFormatter, StrMethodFormatter

    wanted = ("dataset", "cloud", "codec", "rate", "bpp", "d1_rms_m", "points_in", "points_out")
    require_rows(metrics, wanted, "metrics")
    require_numbers(metrics, ("bpp", "d1_rms_m"), "metrics")
    known = metrics.assign(error_mm=1000 * metrics["d1_rms_m"])
    datasets = [
        name
        for name in style.ordered_datasets(known["dataset"])
        if name in compared_datasets(known, clouds)
    ]
    if not datasets:
        raise InputError(f"metrics table: no data set is coded by {OCTREE} and by another codec")
    abreast = panels_abreast(len(datasets))
    figure, panels = panel_grid(len(datasets), abreast, _PANEL_IN, style)
    drawn: set[str] = set()
    for axes, dataset in zip(panels, datasets, strict=True):
        set_log(axes, "x", _LIMITS_MM)
        set_log(axes, "y", _LIMITS, minor=False)
        axes.xaxis.set_major_locator(FixedLocator(_TICKS_MM))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_major_locator(FixedLocator(_TICKS))
        axes.yaxis.set_major_formatter(PercentFormatter(decimals=0))
        axes.axhspan(*_LEARNED, color="#cfcfcf", zorder=1, linewidth=0)
        axes.axhline(100, color=style.of_codec(OCTREE).colour, zorder=2, linewidth=1)
        rows = known[known["dataset"] == dataset]
        drawn |= _draw_codecs(axes, rows, style)
        set_title(axes, style.title(dataset), abreast, style)
    label_outer(panels, abreast, "RMS error to the scan, D1 (mm)", "Bits, share\nof G-PCC's octree")
    add_legend(figure, style.ordered_codecs(drawn), style, _others(style))
    return figure


def compared_datasets(metrics: pd.DataFrame, clouds: pd.DataFrame) -> set[str]:
    """Data sets that the octree and another codec coded, each scene and sensor once.

    Of data sets whose clouds differ in the error model alone the first is taken.
    """
    others = metrics[metrics["codec"] != OCTREE]
    both = set(metrics[metrics["codec"] == OCTREE]["dataset"]) & set(others["dataset"])
    known = clouds[clouds["dataset"].isin(both)]
    alike = [name for name in ("cloud", "sensor", "turns", "firings") if name in known]
    first = known.groupby(alike, dropna=False)["dataset"].transform("first")
    return set(first)


def _draw_codecs(axes: Axes, rows: pd.DataFrame, style: FigureStyle) -> set[str]:
    """Draw the codecs of one panel; the names of those that have a value."""
    octree = rows[rows["codec"] == OCTREE]
    complete = rows[rows["codec"] == COMPLETE_OCTREE]
    drawn: set[str] = set()
    for codec in style.ordered_codecs(rows["codec"]):
        if codec == OCTREE:
            continue
        curve, grids = shares(rows[rows["codec"] == codec], octree, complete)
        look = style.of_codec(codec)
        common: dict[str, Any] = {"color": look.colour, "marker": look.marker, "zorder": 3}
        axes.plot(_ERRORS_MM, curve, color=look.colour, linestyle=look.line, zorder=3)
        axes.plot(_ERRORS_MM[_MARKED], curve[_MARKED], linestyle="", **common)
        halves = np.asarray(GRIDS_MM) / 2
        axes.plot(halves, grids, linestyle="", markerfacecolor="white", **common)
        known = np.concatenate((curve, grids))
        if ((_LIMITS[0] <= known) & (known <= _LIMITS[1])).any():
            drawn.add(codec)
    return drawn


def shares(
    rows: pd.DataFrame, octree: pd.DataFrame, complete: pd.DataFrame
) -> tuple[Floats, Floats]:
    """Bits of a codec in percent of the octree's, medians over the clouds of both.

    Parameters
    ----------
    rows, octree, complete
        Result rows (``cloud``, ``bpp``, ``error_mm``, ``points_in``, ``points_out``) of one data
        set: of the codec, of the octree, and of the octree that keeps every point, if any.

    Returns
    -------
    Floats, Floats
        At errors of 0.5 to 50 mm, and on the grids; nan where the rates of either do not reach.
    """
    anchors = dict(iter(octree.groupby("cloud")))
    lossless = {**anchors, **dict(iter(complete.groupby("cloud")))}
    lines, grids = [], []
    for cloud, curve in rows.groupby("cloud"):
        if (anchor := anchors.get(cloud)) is None:
            continue
        own, other = ((one["bpp"], one["error_mm"]) for one in (curve, anchor))
        lines.append(
            [bits_at_error(*own, mm) / bits_at_error(*other, mm) for mm in _ERRORS_MM.tolist()]
        )
        exact = lossless[cloud]
        grids.append(
            [bits_without_loss(curve, mm) / bits_without_loss(exact, mm) for mm in GRIDS_MM]
        )
    if not lines:
        return np.full(len(_ERRORS_MM), np.nan), np.full(len(GRIDS_MM), np.nan)
    return 100 * np.median(lines, axis=0), 100 * np.median(grids, axis=0)


def _others(style: FigureStyle) -> list[Artist]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    return [
        Line2D([], [], color=style.of_codec(OCTREE).colour, label="G-PCC's octree"),
        Patch(color="#cfcfcf", label="learned codecs, as reported"),
        Line2D(
            [], [], linestyle="", marker="o", color="#444444", markerfacecolor="white",
            label="without loss on a grid",
        ),
    ]  # fmt: skip

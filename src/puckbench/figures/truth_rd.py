"""Distortion to the scan, to its clean twin and to the true surface, side by side, against bpp."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.curves import (
    binned_curves,
    check_curves,
    codecs_of,
    draw_curves,
    shared_limits,
)
from puckbench.figures.panels import (
    SCAN_LINE,
    add_legend,
    codec_handles,
    label_outer,
    panel_grid,
    scan_handle,
    set_title,
)
from puckbench.figures.plotted_metrics import BPP, CD_PLANE, CD_POINT, HD_PLANE, Quantity
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIDES = {
    "": "to the scan",
    "clean_": "to the clean scan",
    "truth_": "to the truth",
}
"""What stands before a column's name, and what the column is measured to; the rays are the same."""
_CLEAN = list(_SIDES).index("clean_")
_EXACT = 1e-12
"""Squared grid units: a scan that is nearer to its clean twin differs by rounding alone."""
_MOST_IN_A_PANEL = 9
"""Codecs whose legend fits into one panel."""


@FIGURES.register(
    "truth_rd",
    title="Distortion to the scan and to the truth (point-to-plane) against bits per point",
    category="Rate-distortion",
)
def draw_chamfer(metrics: pd.DataFrame, scan_errors: pd.DataFrame, style: FigureStyle) -> Figure:
    """Chamfer distance, point-to-plane, in squared grid units, against bits per point: to the
    scan that the codec was given, to the clean scan of the same rays, and to the true
    surface.

    Bins as in figure 6.6, the same axes in all panels. A clean scan is its own clean scan, and has
    one panel for both. Dashed: the scan itself, the median over the data set's clouds; a scan
    without errors lies below the axes. A codec that gives back the scan exactly keeps the scan's
    noise and levels off at this line; below it a codec is closer to the truth than what it was
    given. Not in the thesis.
    """
    return draw_sides(metrics, scan_errors, CD_PLANE, style)


@FIGURES.register(
    "truth_rd_point",
    title="Distortion to the scan and to the truth (point-to-point) against bits per point",
    category="Rate-distortion",
)
def draw_chamfer_point(
    metrics: pd.DataFrame, scan_errors: pd.DataFrame, style: FigureStyle
) -> Figure:
    """As the figure before, point-to-point.

    To the clean scan decoded points keep a distance where they lie between the rays; to the true
    surface they do not. Not in the thesis.
    """
    return draw_sides(metrics, scan_errors, CD_POINT, style)


@FIGURES.register(
    "truth_rd_hausdorff",
    title="Hausdorff distance to the scan and to the truth (point-to-plane, squared)",
    category="Rate-distortion",
)
def draw_hausdorff(metrics: pd.DataFrame, scan_errors: pd.DataFrame, style: FigureStyle) -> Figure:
    """Hausdorff distance, point-to-plane, squared, in squared grid units, against bits per
    point: to the scan that the codec was given, to the clean scan of the same rays, and to
    the true surface.

    Dashed: the scan itself. Bins as in figure 6.6, panels as in the figures before. Not in the
    thesis.
    """
    return draw_sides(metrics, scan_errors, HD_PLANE, style)


def draw_sides(
    metrics: pd.DataFrame, scan_errors: pd.DataFrame, quantity: Quantity, style: FigureStyle
) -> Figure:
    """Draw a row of panels for each scanned data set, one panel for each reference.

    All panels have the same axes, so that the columns compare by eye: a codec that keeps the scan's
    noise falls on the left and levels off beside, at the dashed line of the scan's own error (the
    median over the data set's clouds). A line below the axes (a scan without errors) is left out,
    and so is the panel of a clean scan that is the scan itself: it would show the first again.

    Parameters
    ----------
    metrics
        Result rows.
    scan_errors
        Distances of the scans themselves to the clean scans and to the truth.
    quantity
        The distance to the scan; its twins have the columns ``clean_...`` and ``truth_...``.
    style
        Of the figure.
    """
    sides = [replace(quantity, column=f"{prefix}{quantity.column}") for prefix in _SIDES]
    for side in sides:
        check_curves(metrics, side)
    known = metrics.dropna(subset=[side.column for side in sides[1:]])
    curves = [binned_curves(known, side, style) for side in sides]
    every = [lines for side in curves for lines in side.values()]
    limits = [shared_limits(every, q, style, fitted=True) for q in (BPP, quantity)]
    own = _own_errors(scan_errors, sides[1:])
    figure, panels = panel_grid(len(every), len(sides), 1.95, style)
    for index, axes in enumerate(panels):
        dataset, column = list(curves[0])[index // len(sides)], index % len(sides)
        draw_curves(axes, curves[column][dataset], limits[0], limits[1], style)
        own_error = own.get((dataset, sides[column].column))
        if column == _CLEAN and own_error is not None and own_error < _EXACT:
            axes.clear()
            axes.set_axis_off()
            continue
        _draw_own(axes, own_error, limits[1][0])
        set_title(axes, f"{style.title(dataset)}: {list(_SIDES.values())[column]}", 3, style)
    label_outer(panels, len(sides), BPP.label, quantity.short_label)
    _add_legend(figure, panels, codecs_of(every, style), style)
    return figure


def _own_errors(scan_errors: pd.DataFrame, sides: list[Quantity]) -> dict[tuple[str, str], float]:
    """Medians of the scans' own errors by data set and column."""
    columns = tuple(side.column for side in sides)
    require_rows(scan_errors, ("dataset", *columns), "scan errors")
    require_numbers(scan_errors, columns, "scan errors")
    medians = scan_errors.groupby("dataset")[list(columns)].median()
    return {
        (str(dataset), column): float(row[column])
        for dataset, row in medians.iterrows()
        for column in columns
    }


def _draw_own(axes: Axes, value: float | None, floor: float) -> None:
    if value is not None and value >= floor:
        axes.axhline(value, zorder=2, **SCAN_LINE)


def _add_legend(figure: Figure, panels: list[Axes], codecs: list[str], style: FigureStyle) -> None:
    """The legend, in the place of the first panel that was left out, else above all."""
    own = scan_handle()
    free = next((axes for axes in panels if not axes.axison), None)
    if free is None or len(codecs) > _MOST_IN_A_PANEL:
        add_legend(figure, codecs, style, (own,))
    else:
        free.legend(handles=[*codec_handles(codecs, style), own], loc="center")

"""Distortion to the coded cloud and to the true surface, side by side, against bits per point."""

from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.figures.curves import (
    binned_curves,
    check_curves,
    codecs_of,
    draw_curves,
    shared_limits,
)
from puckbench.figures.panels import add_legend, panel_grid, set_title
from puckbench.figures.quantities import BPP, CD_PLANE, TRUTH_CD_PLANE
from puckbench.figures.style import FigureStyle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_SIDES = ((CD_PLANE, "to the coded cloud"), (TRUTH_CD_PLANE, "to the true surface"))


def draw_truth_curves(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """One row per data set with truth: CD to what the codec was given, and CD to the truth.

    All panels share their axes, so that left and right compare by eye: a codec that keeps the
    scan's noise falls on the left and levels off on the right, at that noise.
    """
    for quantity, _ in _SIDES:
        check_curves(metrics, quantity)
    known = metrics.dropna(subset=[TRUTH_CD_PLANE.column])
    sides = [binned_curves(known, quantity, style) for quantity, _ in _SIDES]
    every = [lines for side in sides for lines in side.values()]
    x_limits, y_limits = (shared_limits(every, q, style) for q in (BPP, CD_PLANE))
    figure, panels = panel_grid(len(every), 2, 2.1, style)
    for axes, index in zip(panels, range(len(every)), strict=True):
        dataset = list(sides[0])[index // 2]
        draw_curves(axes, sides[index % 2][dataset], x_limits, y_limits, style)
        set_title(axes, f"{style.title(dataset)}: {_SIDES[index % 2][1]}", 2, style)
    for axes in panels[::2]:
        axes.set_ylabel(CD_PLANE.label)
    for axes in panels[-2:]:
        axes.set_xlabel(BPP.label)
    add_legend(figure, codecs_of(every, style), style)
    return figure

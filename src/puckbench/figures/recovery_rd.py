"""Recovery of geometric primitives against bits per point: precision, recall, labels of points."""

from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.curves import Lines, binned_curves, codecs_of, shared_limits
from puckbench.figures.panels import (
    add_legend,
    draw_line,
    label_outer,
    panel_grid,
    set_log,
    set_title,
)
from puckbench.figures.plotted_metrics import BPP, Quantity
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle, Range

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHARES = (
    Quantity("precision", "precision", "share", (0, 1)),
    Quantity("recall", "recall", "share", (0, 1)),
    Quantity("label_accuracy", "label accuracy", "share", (0, 1)),
)
ALL = "all"


@FIGURES.register(
    "recovery_rd",
    title="Recovery of the scenes' geometric primitives against bits per point",
    category="Rate-distortion",
)
def draw_recovery(recovery: pd.DataFrame, style: FigureStyle) -> Figure:
    """Geometric primitives of decoded surfaces against the labels of the scenes: the share of
    those found that are true (precision), of the true that are found (recall), and of the
    points on true primitives that are on the one found for it, against bits per point;
    medians in bins as in figure 6.6.

    Only for codecs that decode labelled surfaces and for scenes that have labels; streams without
    primitives are left out. Not in the thesis.
    """
    columns = tuple(share.column for share in _SHARES)
    require_rows(
        recovery, ("dataset", "cloud", "codec", "rate", "kind", BPP.column, *columns), "recovery"
    )
    require_numbers(recovery, (BPP.column, *columns), "recovery")
    whole = recovery[recovery["kind"] == ALL].dropna(subset=[_SHARES[-1].column])
    curves = [binned_curves(whole, share, style) for share in _SHARES]
    every = [lines for side in curves for lines in side.values()]
    x_limits = shared_limits(every, BPP, style, (0.01, 1))
    figure, panels = panel_grid(len(every), len(_SHARES), 1.95, style)
    for index, axes in enumerate(panels):
        dataset, column = list(curves[0])[index // len(_SHARES)], index % len(_SHARES)
        _draw_panel(axes, curves[column][dataset], x_limits, style)
        set_title(axes, f"{style.title(dataset)}: {_SHARES[column].words}", len(_SHARES), style)
    label_outer(panels, len(_SHARES), BPP.label, "Share")
    add_legend(figure, codecs_of(every, style), style)
    return figure


def _draw_panel(axes: Axes, lines: Lines, x_limits: Range, style: FigureStyle) -> None:
    set_log(axes, "x", x_limits)
    axes.set_ylim(0, 1)
    for codec, (bpp, shares) in lines.items():
        draw_line(axes, bpp, shares, style.of_codec(codec), floor=0.0)

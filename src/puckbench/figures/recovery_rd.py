from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.figures.axis_labels import BPP, HIGHER_BETTER, axis_label
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.curves import Lines, binned_curves, codecs_of, mark_handles, shared_limits
from puckbench.figures.panels import (
    add_legend,
    draw_curve,
    label_outer,
    panel_grid,
    set_log,
    set_title,
    titled,
)
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle, Range
from puckbench.results.columns import column_named

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_METRICS = tuple(map(column_named, ("precision", "recall", "label_accuracy")))
ALL = "all"


@FIGURES.register(
    "recovery_rd",
    title="Recovery of geometric primitives against bits per point",
    category="Rate-distortion",
)
def draw_recovery(recovery: pd.DataFrame, style: FigureStyle) -> Figure:
    """Recovery of geometric primitives against bits per point: precision (share of decoded
    primitives that match a true one), recall (share of true primitives that were decoded) and
    label accuracy (share of points on true primitives that lie on the matching primitive).
    Markers are medians of ten bins with equally many results or, with few clouds, of each rate.
    Bars are quartiles; with fewer than six clouds, there is a dot for each cloud instead.

    Only codecs that decode labelled surfaces, and streams with primitives, are shown.
    """
    columns = tuple(metric.name for metric in _METRICS)
    require_rows(
        recovery, ("dataset", "cloud", "codec", "rate", "kind", BPP.name, *columns), "recovery"
    )
    require_numbers(recovery, (BPP.name, *columns), "recovery")
    all_kinds = recovery[recovery["kind"] == ALL].dropna(subset=[_METRICS[-1].name])
    curves = [binned_curves(all_kinds, metric, style) for metric in _METRICS]
    panel_lines = [lines for dataset_curves in curves for lines in dataset_curves.values()]
    x_limits = shared_limits(panel_lines, BPP, style)
    figure, panels = panel_grid(len(panel_lines), len(_METRICS), 1.95, style)
    for index, axes in enumerate(panels):
        dataset, place = list(curves[0])[index // len(_METRICS)], index % len(_METRICS)
        _draw_panel(axes, curves[place][dataset], x_limits, style)
        rows = all_kinds[all_kinds["dataset"] == dataset]
        title = titled(f"{style.title(dataset)}: {_METRICS[place].words.lower()}", rows)
        set_title(axes, title, len(_METRICS), style)
    label_outer(panels, len(_METRICS), axis_label(BPP), f"Share, {HIGHER_BETTER}")
    add_legend(figure, codecs_of(panel_lines, style), style, mark_handles(panel_lines))
    return figure


def _draw_panel(axes: Axes, lines: Lines, x_limits: Range, style: FigureStyle) -> None:
    set_log(axes, "x", x_limits)
    axes.set_ylim(0, 1)
    for codec, curve in lines.items():
        draw_curve(axes, curve, style.of_codec(codec))

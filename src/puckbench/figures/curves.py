from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from pointkit.errors import InputError
from puckbench.figures.axis_labels import BPP, axis_label
from puckbench.figures.binning import Curve, medians_against
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import (
    SCAN_LINE,
    add_legend,
    draw_curve,
    label_outer,
    log_limits,
    lossless_tick_handle,
    panel_grid,
    panels_abreast,
    scan_handle,
    set_log,
    set_title,
    spread_handles,
    titled,
    unranked_handle,
)
from puckbench.figures.style import FigureStyle, Range
from puckbench.metrics.timing import unranked_codecs
from puckbench.results.columns import Column

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Lines = dict[str, Curve]
"""The curve of each codec in a panel, by name of the codec."""


def check_curve_columns(metrics: pd.DataFrame, metric: Column) -> None:
    """Raise InputError unless a table of results has the values for curves on logarithmic axes."""
    columns = (BPP.name, metric.name)
    require_rows(metrics, ("dataset", "cloud", "codec", "rate", *columns), "metrics")
    require_numbers(metrics, columns, "metrics")
    if (metrics[BPP.name] == 0).any():
        raise InputError("metrics table: column 'bpp' has a value of zero: a stream of no bytes")


def binned_curves(metrics: pd.DataFrame, metric: Column, style: FigureStyle) -> dict[str, Lines]:
    """Return medians of a metric against bits per point, for each data set and codec.

    Parameters
    ----------
    metrics
        Results of a run.
    metric
        The metric to draw.
    style
        Style of the figure, which determines the order of data sets and codecs.

    Returns
    -------
    dict
        Curves by data set, then by codec.
    """
    curves: dict[str, Lines] = {name: {} for name in style.ordered_datasets(metrics["dataset"])}
    for dataset, lines in curves.items():
        rows = metrics[metrics["dataset"] == dataset].dropna(subset=[BPP.name, metric.name])
        for codec in style.ordered_codecs(rows["codec"]):
            codec_rows = rows[rows["codec"] == codec]
            lines[codec] = medians_against(codec_rows, BPP.name, metric.name)
    return curves


def codecs_of(curves: Iterable[Lines], style: FigureStyle) -> list[str]:
    """Return the names of all codecs that have a curve, in the order of legends."""
    return style.ordered_codecs(codec for lines in curves for codec in lines)


def draw_curves(
    axes: Axes,
    lines: Lines,
    x_limits: Range,
    y_limits: Range,
    style: FigureStyle,
    unranked: Collection[str] = (),
) -> None:
    """Draw the curves of all codecs in one panel, with logarithmic axes.

    Parameters
    ----------
    axes
        The panel.
    lines
        Curves by codec.
    x_limits, y_limits
        Limits of the axes.
    style
        Style of the figure.
    unranked
        Codecs whose lines are dotted, because their times cannot be ranked.
    """
    set_log(axes, "x", x_limits)
    set_log(axes, "y", y_limits)
    for codec, curve in lines.items():
        draw_curve(axes, curve, style.of_codec(codec), faint=codec in unranked)
    if not lines:
        axes.text(0.5, 0.5, "no values", transform=axes.transAxes, ha="center", va="center")


def draw_data_sets(
    metrics: pd.DataFrame,
    metric: Column,
    style: FigureStyle,
    *,
    bits: str = axis_label(BPP),
    panel_in: float | None = None,
    scans: Mapping[str, float] = MappingProxyType({}),
) -> Figure:
    """Draw a metric against bits, with a panel for each data set and a line for each codec.

    Parameters
    ----------
    metrics
        Results of a run.
    metric
        The metric to draw.
    style
        Style of the figure.
    bits
        Label of the horizontal axis.
    panel_in
        Height of a panel, in inches; by default, it depends on the number of panels.
    scans
        Value of the metric for the scans before coding, by data set, drawn as a dashed line.
    """
    check_curve_columns(metrics, metric)
    curves = binned_curves(metrics, metric, style)
    limits = [shared_limits(curves.values(), of_axis, style) for of_axis in (BPP, metric)]
    abreast = panels_abreast(len(curves))
    is_tall = panel_in is None and abreast < 3
    height = panel_in or (2.5 if is_tall else 2.0)
    figure, panels = panel_grid(len(curves), abreast, height, style)
    for axes, (dataset, lines) in zip(panels, curves.items(), strict=True):
        rows = metrics[metrics["dataset"] == dataset]
        unranked = unranked_codecs(rows) if metric.timed else ()
        draw_curves(axes, lines, limits[0], limits[1], style, unranked)
        if dataset in scans:
            axes.axhline(scans[dataset], zorder=2, **SCAN_LINE)
        set_title(axes, titled(style.title(dataset), rows), abreast, style)
    label_outer(panels, abreast, bits, axis_label(metric) if is_tall else axis_label(metric, 2))
    extra_handles = [scan_handle()] if scans else []
    extra_handles += [unranked_handle()] if metric.timed and unranked_codecs(metrics) else []
    add_legend(
        figure,
        codecs_of(curves.values(), style),
        style,
        [*extra_handles, *mark_handles(curves.values())],
    )
    return figure


def mark_handles(curves: Iterable[Lines]) -> list[Artist]:
    """Return legend entries that explain the marks of the given curves.

    Marks are bars of quartiles, dots of single clouds, and ticks of lossless streams. A mark that
    no curve has gets no entry.
    """
    drawn = [curve for lines in curves for curve in lines.values()]
    has_lossless = any((curve.y == 0).any() for curve in drawn)
    return spread_handles(drawn) + ([lossless_tick_handle()] if has_lossless else [])


def shared_limits(curves: Iterable[Lines], metric: Column, style: FigureStyle) -> Range:
    """Return the limits of a logarithmic axis that all panels share.

    Parameters
    ----------
    curves
        Curves by codec, of each panel.
    metric
        The metric on the axis; `BPP` for the horizontal axis.
    style
        Style of the figure, which may set the range (see `log_limits`).
    """
    drawn = [curve for lines in curves for curve in lines.values()]
    arrays = [values for curve in drawn for values in (curve.x, curve.singles[:, 0])]
    if metric is not BPP:
        arrays = [v for c in drawn for v in (c.y, c.low, c.high, c.singles[:, 1])]
    return log_limits(np.concatenate([np.empty(0), *arrays]), metric.name, style)

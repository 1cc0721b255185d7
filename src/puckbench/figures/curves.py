"""Rate-distortion curves of a results table: medians against bpp, drawn log-log."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from puckbench.core.errors import InputError
from puckbench.figures.binning import medians_against
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import (
    SCAN_LINE,
    add_legend,
    draw_line,
    fitted_limits,
    label_outer,
    log_limits,
    panel_grid,
    panels_abreast,
    scan_handle,
    set_log,
    set_title,
)
from puckbench.figures.plotted_metrics import BPP, Quantity
from puckbench.figures.style import FigureStyle, Range
from puckbench.geometry.cloud import Floats

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Lines = dict[str, tuple[Floats, Floats]]
"""codec -> medians of bpp and of the metric, one per bin or rate."""


def check_curves(metrics: pd.DataFrame, quantity: Quantity) -> None:
    """Check that a table of results has what curves of a quantity against bits per point need.

    Raises
    ------
    InputError
        A column is missing or empty, or has values that a logarithmic axis cannot show.
    """
    numbers = (BPP.column, quantity.column)
    require_rows(metrics, ("dataset", "cloud", "codec", "rate", *numbers), "metrics")
    require_numbers(metrics, numbers, "metrics")
    if (metrics[BPP.column] == 0).any():
        raise InputError("metrics table: column 'bpp' has a value of zero: a stream of no bytes")


def binned_curves(
    metrics: pd.DataFrame, quantity: Quantity, style: FigureStyle
) -> dict[str, Lines]:
    """Medians of a quantity and of bits per point for each data set and codec.

    Parameters
    ----------
    metrics
        Result rows.
    quantity
        What is drawn upwards.
    style
        Gives the order of data sets and codecs.

    Returns
    -------
    dict of str to Lines
        Data set -> codec -> medians of bpp and of the quantity.
    """
    curves: dict[str, Lines] = {name: {} for name in style.ordered_datasets(metrics["dataset"])}
    for dataset, lines in curves.items():
        rows = metrics[metrics["dataset"] == dataset].dropna(subset=[BPP.column, quantity.column])
        for codec in style.ordered_codecs(rows["codec"]):
            of_codec = rows[rows["codec"] == codec]
            lines[codec] = medians_against(of_codec, BPP.column, quantity.column)
    return curves


def codecs_of(curves: Iterable[Lines], style: FigureStyle) -> list[str]:
    """The codecs that have a line in any panel, in the order of the legend."""
    return style.ordered_codecs(codec for lines in curves for codec in lines)


def draw_curves(
    axes: Axes, lines: Lines, x_limits: Range, y_limits: Range, style: FigureStyle
) -> None:
    """Draw the lines of one panel on logarithmic axes; a panel without any says "no values".

    Parameters
    ----------
    axes
        The panel.
    lines
        Codec -> medians of bpp and of the quantity.
    x_limits, y_limits
        Of the axes.
    style
        Gives the lines' colours and markers.
    """
    set_log(axes, "x", x_limits)
    set_log(axes, "y", y_limits)
    for codec, (bpp, values) in lines.items():
        draw_line(axes, bpp, values, style.of_codec(codec), floor=y_limits[0])
    if not lines:
        axes.text(0.5, 0.5, "no values", transform=axes.transAxes, ha="center", va="center")


def draw_data_sets(
    metrics: pd.DataFrame,
    quantity: Quantity,
    style: FigureStyle,
    *,
    bits: str = BPP.label,
    panel_in: float | None = None,
    fitted: bool = False,
    scans: Mapping[str, float] = MappingProxyType({}),
) -> Figure:
    """Curves of a quantity: one panel per data set, one line per codec, the same axes in all.

    Parameters
    ----------
    metrics
        Result rows.
    quantity
        What is drawn upwards.
    style
        Gives ranges, colours, names and the order of data sets and codecs.
    bits
        Name of the horizontal axis.
    panel_in
        Height of a panel in inches, with a short label; by default as many panels abreast ask for.
    fitted
        As in `shared_limits`.
    scans
        Data set -> the quantity of the scans themselves, drawn as a line.
    """
    check_curves(metrics, quantity)
    curves = binned_curves(metrics, quantity, style)
    limits = [shared_limits(curves.values(), q, style, fitted=fitted) for q in (BPP, quantity)]
    abreast = panels_abreast(len(curves))
    is_high = panel_in is None and abreast < 3
    height = panel_in or (2.5 if is_high else 2.0)
    figure, panels = panel_grid(len(curves), abreast, height, style)
    for axes, (dataset, lines) in zip(panels, curves.items(), strict=True):
        draw_curves(axes, lines, limits[0], limits[1], style)
        if dataset in scans:
            axes.axhline(scans[dataset], zorder=2, **SCAN_LINE)
        set_title(axes, style.title(dataset), abreast, style)
    label_outer(panels, abreast, bits, quantity.label if is_high else quantity.short_label)
    others = (scan_handle(),) if scans else ()
    add_legend(figure, codecs_of(curves.values(), style), style, others)
    return figure


def shared_limits(
    curves: Iterable[Lines],
    quantity: Quantity,
    style: FigureStyle,
    default: Range | None = None,
    fitted: bool = False,
) -> Range:
    """Limits of one axis for all panels of a figure.

    Parameters
    ----------
    curves
        The lines of every panel.
    quantity
        `BPP` for the horizontal axis, any other for the vertical one.
    style
        Its ranges have precedence.
    default
        Range where the style has none; None for the quantity's own.
    fitted
        Whether, where the style has none, the values alone give the limits.
    """
    which = 0 if quantity is BPP else 1
    arrays = [line[which] for lines in curves for line in lines.values()]
    values = np.concatenate([np.empty(0), *arrays])
    if fitted and quantity.column not in style.axis_ranges:
        return fitted_limits(values, default or quantity.limits)
    return log_limits(values, style.axis_range(quantity.column, default or quantity.limits))

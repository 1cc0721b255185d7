"""Rate-distortion curves of a results table: medians against bpp, drawn log-log."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from puckbench.core.errors import InputError
from puckbench.figures.binning import medians_against
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import draw_line, fitted_limits, log_limits, set_log
from puckbench.figures.quantities import BPP, Quantity
from puckbench.figures.style import FigureStyle, Range
from puckbench.geometry.cloud import Floats

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

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

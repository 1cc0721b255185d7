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
    """InputError unless the table has what a curve of `quantity` against bpp needs."""
    numbers = (BPP.column, quantity.column)
    require_rows(metrics, ("dataset", "cloud", "codec", "rate", *numbers), "metrics")
    require_numbers(metrics, numbers, "metrics")
    if (metrics[BPP.column] == 0).any():
        raise InputError("metrics table: column 'bpp' has a value of zero: a stream of no bytes")


def binned_curves(
    metrics: pd.DataFrame, quantity: Quantity, style: FigureStyle
) -> dict[str, Lines]:
    """Medians per data set and codec, of all rates; data sets and codecs in drawing order."""
    curves: dict[str, Lines] = {name: {} for name in style.ordered_datasets(metrics["dataset"])}
    for dataset, lines in curves.items():
        rows = metrics[metrics["dataset"] == dataset].dropna(subset=[BPP.column, quantity.column])
        for codec in style.ordered_codecs(rows["codec"]):
            of_codec = rows[rows["codec"] == codec]
            lines[codec] = medians_against(of_codec, BPP.column, quantity.column)
    return curves


def codecs_of(curves: Iterable[Lines], style: FigureStyle) -> list[str]:
    """The codecs that have a line somewhere, in legend order."""
    return style.ordered_codecs(codec for lines in curves for codec in lines)


def draw_curves(
    axes: Axes, lines: Lines, x_limits: Range, y_limits: Range, style: FigureStyle
) -> None:
    """The lines of one panel; a panel without any says so."""
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
    """Limits of one quantity for all panels: bpp's from the first array of each line, or y's.

    default: range of the axis where the style has none; the quantity's own if not given.
    fitted: whether, where the style has none, the values alone give the limits.
    """
    which = 0 if quantity is BPP else 1
    arrays = [line[which] for lines in curves for line in lines.values()]
    values = np.concatenate([np.empty(0), *arrays])
    if fitted and quantity.column not in style.axis_ranges:
        return fitted_limits(values, default or quantity.limits)
    return log_limits(values, style.axis_range(quantity.column, default or quantity.limits))

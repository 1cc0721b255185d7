"""Panels of what coding adds to an error or takes from a result, with the margin that allows it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.geometry.cloud import Floats
from puckbench.figures.panels import line_handle
from puckbench.metrics.statistics import MIN_SCENES

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_COLOUR = "#dcdcdc"


def set_losses(axes: Axes, rows: pd.DataFrame, columns: list[str]) -> None:
    """Make the vertical axis linear below the least margin, and logarithmic above.

    Parameters
    ----------
    axes
        Panel with the axis.
    rows
        Table with the column ``margin``.
    columns
        Columns of the table whose values the axis covers.
    """
    from matplotlib.ticker import NullLocator, StrMethodFormatter, SymmetricalLogLocator

    linear = float(rows["margin"].min())
    ends = rows[columns].to_numpy(float)
    axes.set_yscale("symlog", linthresh=linear)
    low, high = min(np.nanmin(ends), 0.0), max(np.nanmax(ends), linear)
    axes.set_ylim(min(1.3 * low, -0.5 * linear), 1.6 * high)
    axes.yaxis.set_major_locator(SymmetricalLogLocator(linthresh=linear, base=10))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_locator(NullLocator())


def draw_margin(axes: Axes, margin: float) -> None:
    """Draw the band between 0 and a margin, behind all else."""
    axes.axhspan(0, margin, color=_COLOUR, linewidth=0, zorder=1)


def draw_intervals(
    axes: Axes, bits: Floats, curve: pd.DataFrame, samples: int, **line: Any
) -> None:
    """Draw a bar for the interval at each rate, or dots at the extremes if samples are few.

    Parameters
    ----------
    axes
        Panel in which to draw.
    bits
        Places of the rates on the horizontal axis, (n,).
    curve
        Table of n rows with the columns ``low`` and ``high``, or ``least`` and ``most``.
    samples
        Number of scenes or trajectories. There are bars for `MIN_SCENES` or more.
    **line
        Properties of bars and dots; ``linewidth`` is that of bars.
    """
    if samples >= MIN_SCENES:
        axes.vlines(bits, curve["low"], curve["high"], **line)
        return
    del line["linewidth"]
    for column in ("least", "most"):
        axes.plot(bits, curve[column], marker=".", markersize=2, linestyle="", **line)


def handles_of_margin(rows: pd.DataFrame) -> list[Artist]:
    """Return the entries of the legend for the margin and, if there are any, for intervals."""
    from matplotlib.patches import Patch

    margin = Patch(color=_COLOUR, label="margin")
    if not rows["low"].notna().any():
        return [margin]
    return [margin, line_handle("95 % interval", color="#555555", marker="|", linestyle="")]

"""Metrics against bits per point, one panel per data set (thesis Figures 6.6 to 6.9)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.figures.curves import draw_data_sets
from puckbench.figures.plotted_metrics import (
    CD_PLANE,
    DECODE_TIME,
    ENCODE_TIME,
    HD_PLANE,
)
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@FIGURES.register(
    "fig_6_6",
    title="Chamfer distance (point-to-plane) against bits per point",
    category="Rate-distortion",
    number="6.6",
)
def draw_chamfer(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Chamfer distance, point-to-plane, in squared grid units, against bits per point, both
    axes logarithmic (thesis figure 6.6).

    For each data set and codec the results of all clouds and rates are sorted by bpp and parted
    into ten bins of equal count; a marker is the median bpp and the median value of one bin. With
    no more than ten different bpp values each has its own marker. The axes are the same in all
    panels and at least the thesis's (0.01 to 100 bpp, 0.01 to 1,000), widened by whole decades
    where values fall outside. A hollow marker on the lower edge is a median of zero (lossless).
    Bits per point count the geometry alone; the thesis's Draco also coded the scans' other
    attributes.
    """
    return draw_data_sets(metrics, CD_PLANE, style)


@FIGURES.register(
    "fig_6_7",
    title="Hausdorff distance (point-to-plane, squared) against bits per point",
    category="Rate-distortion",
    number="6.7",
)
def draw_hausdorff(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Squared Hausdorff distance, point-to-plane, in squared grid units, against bits per
    point, both axes logarithmic (thesis figure 6.7).

    Bins and axes as in figure 6.6, the thesis's vertical axis from 0.1 to 10,000. The thesis calls
    this quantity the Hausdorff distance; its tool reports the square, and so does this figure. The
    tables have both.
    """
    return draw_data_sets(metrics, HD_PLANE, style)


@FIGURES.register(
    "fig_6_8",
    title="Encoding time against bits per point",
    category="Rate-distortion",
    number="6.8",
)
def draw_encoding_time(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Encoding time in seconds against bits per point, both axes logarithmic (thesis figure
    6.8).

    Bins and axes as in figure 6.6, the thesis's vertical axis from 0.1 to 100 s. Times are medians
    of repeated calls inside one process; the thesis's are whole processes, their start and the
    loading of weights included.
    """
    return draw_data_sets(metrics, ENCODE_TIME, style)


@FIGURES.register(
    "fig_6_9",
    title="Decoding time against bits per point",
    category="Rate-distortion",
    number="6.9",
)
def draw_decoding_time(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Decoding time in seconds against bits per point, both axes logarithmic (thesis figure
    6.9).

    Bins, axes and times as in figure 6.8.
    """
    return draw_data_sets(metrics, DECODE_TIME, style)

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from puckbench.figures.axis_labels import CD_PLANE, DECODE_TIME, ENCODE_TIME, HD_PLANE
from puckbench.figures.curves import draw_data_sets
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_figure = partial(FIGURES.register, category="Rate-distortion")


@_figure(
    "chamfer_rd",
    title="Chamfer distance (point-to-plane) against bits per point",
    is_first_look=True,
)
def draw_chamfer(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Chamfer distance (point-to-plane, squared grid units) against bits per point.

    Markers are medians of ten bins with equally many results or, with few clouds, of each rate.
    Bars are quartiles, and n is the number of clouds. Ticks at the lower edge mark distances of
    zero (lossless). Bits are those of the geometry only.
    """
    return draw_data_sets(metrics, CD_PLANE, style)


@_figure(
    "hausdorff_rd",
    title="Hausdorff distance (point-to-plane, squared) against bits per point",
)
def draw_hausdorff(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Squared Hausdorff distance (point-to-plane, squared grid units) against bits per point.

    Markers, bars and ticks are as in the figure of the Chamfer distance.
    """
    return draw_data_sets(metrics, HD_PLANE, style)


@_figure("encoding_time", title="Encoding time against bits per point")
def draw_encoding_time(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Encoding time in seconds, without the start of a process, against bits per point.

    Markers and bars are as in the figure of the Chamfer distance. Dotted lines are times that
    cannot be ranked, because other jobs ran or fewer than three calls were timed.
    """
    return draw_data_sets(metrics, ENCODE_TIME, style)


@_figure("decoding_time", title="Decoding time against bits per point", is_first_look=True)
def draw_decoding_time(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Decoding time in seconds, without the start of a process, against bits per point.

    Markers and bars are as in the figure of the Chamfer distance. Dotted lines are times that
    cannot be ranked, because other jobs ran or fewer than three calls were timed.
    """
    return draw_data_sets(metrics, DECODE_TIME, style)

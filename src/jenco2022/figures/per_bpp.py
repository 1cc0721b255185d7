from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from puckbench.figures.curves import draw_data_sets
from puckbench.figures.plotted_metrics import CD_PLANE, DECODE_TIME, ENCODE_TIME, HD_PLANE
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_figure = partial(FIGURES.register, category="Rate-distortion")


@_figure("fig_6_6", title="Chamfer distance (point-to-plane) against bits per point", number="6.6")
def draw_chamfer(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Chamfer distance (point-to-plane, squared grid units) against bits per point (thesis figure
    6.6).

    Markers: medians of ten bins of equally many results or, with few clouds, of each rate. Bars:
    quartiles. n: clouds. Ticks at the lower edge: zero (lossless). Bits of geometry only; in the
    thesis, Draco also coded other attributes of scans.
    """
    return draw_data_sets(metrics, CD_PLANE, style)


@_figure(
    "fig_6_7",
    title="Hausdorff distance (point-to-plane, squared) against bits per point",
    number="6.7",
)
def draw_hausdorff(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Squared Hausdorff distance (point-to-plane, squared grid units) against bits per point
    (thesis figure 6.7).

    Markers as in figure 6.6. The thesis omits "squared", but the tool reports squared distances.
    """
    return draw_data_sets(metrics, HD_PLANE, style)


@_figure("fig_6_8", title="Encoding time against bits per point", number="6.8")
def draw_encoding_time(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Encoding time in seconds against bits per point (thesis figure 6.8).

    Markers as in figure 6.6. Dotted: times that cannot be ranked, because other jobs ran or fewer
    than three calls were timed. Unlike in the thesis, times exclude the start of a process.
    """
    return draw_data_sets(metrics, ENCODE_TIME, style)


@_figure("fig_6_9", title="Decoding time against bits per point", number="6.9")
def draw_decoding_time(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Decoding time in seconds against bits per point, as in figure 6.8 (thesis figure 6.9)."""
    return draw_data_sets(metrics, DECODE_TIME, style)

"""Metrics against bits per point, one panel per data set (thesis Figures 6.6 to 6.9)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.figures.curves import (
    binned_curves,
    check_curves,
    codecs_of,
    draw_curves,
    shared_limits,
)
from puckbench.figures.panels import add_legend, panel_grid, panels_abreast, set_title
from puckbench.figures.quantities import (
    BPP,
    CD_PLANE,
    DECODE_TIME,
    ENCODE_TIME,
    HD_PLANE,
    Quantity,
)
from puckbench.figures.style import FigureStyle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


def draw_chamfer(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Figure 6.6: Chamfer distance, point-to-plane."""
    return draw_against_bpp(metrics, CD_PLANE, style)


def draw_hausdorff(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Figure 6.7: Hausdorff distance, point-to-plane, squared as the thesis drew it."""
    return draw_against_bpp(metrics, HD_PLANE, style)


def draw_encoding_time(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Figure 6.8: encoding time."""
    return draw_against_bpp(metrics, ENCODE_TIME, style)


def draw_decoding_time(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Figure 6.9: decoding time."""
    return draw_against_bpp(metrics, DECODE_TIME, style)


def draw_against_bpp(metrics: pd.DataFrame, quantity: Quantity, style: FigureStyle) -> Figure:
    """One panel per data set, log-log, one line per codec, the same axes in all panels."""
    check_curves(metrics, quantity)
    curves = binned_curves(metrics, quantity, style)
    x_limits, y_limits = (shared_limits(curves.values(), q, style) for q in (BPP, quantity))
    columns = panels_abreast(len(curves))
    figure, panels = panel_grid(len(curves), columns, 2.5 if columns < 3 else 2.0, style)
    for axes, (dataset, lines) in zip(panels, curves.items(), strict=True):
        draw_curves(axes, lines, x_limits, y_limits, style)
        set_title(axes, style.title(dataset), columns, style)
    for axes in panels[::columns]:
        axes.set_ylabel(quantity.label if columns < 3 else quantity.short_label)
    for axes in panels[-columns:]:
        axes.set_xlabel(BPP.label)
    add_legend(figure, codecs_of(curves.values(), style), style)
    return figure

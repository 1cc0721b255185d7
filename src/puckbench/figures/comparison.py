"""Curves of one's own codecs beside those of reference results, which are grey."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.figures.binning import medians_against
from puckbench.figures.panels import (
    add_rows_legend,
    figure_width,
    label_outer,
    lossless_handle,
    set_title,
)
from puckbench.figures.plot_styles import PlotStyle
from puckbench.figures.style import FigureStyle
from puckbench.metrics.lossless import MOST_DB, lossless_rows, with_lossless_best
from puckbench.metrics.peaks import WITH_PEAK, peak_phrase, without_mixed_peaks

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

_GREYS = ("#6f6f6f", "#8f8f8f", "#adadad")
_PANEL_IN = 2.1
_LABELS = {"d1_psnr": "D1 PSNR (dB)", "d2_psnr": "D2 PSNR (dB)"}


def draw_comparison(
    metrics: pd.DataFrame,
    reference: pd.DataFrame,
    qualities: Sequence[str],
    study: str,
    style: FigureStyle,
) -> Figure:
    """Draw the medians over the clouds of each data set: a row of panels, one for each quality.

    Parameters
    ----------
    metrics
        Result rows of one's own codecs.
    reference
        Reference results on the same clouds.
    qualities
        Columns that are drawn upwards; PSNRs linearly, others logarithmically. A lossless rate
        stands hollow at the edge: above all PSNRs, below all errors.
    study
        Name of the reference results, for the legend.
    style
        Titles and order of the data sets; colours of one's own codecs.
    """
    from matplotlib.figure import Figure

    peak = peak_phrase(metrics)
    metrics, reference = (with_lossless_best(without_mixed_peaks(t)) for t in (metrics, reference))
    datasets = style.ordered_datasets(metrics["dataset"])
    shape = (len(datasets), len(qualities))
    figure = Figure(figsize=(figure_width(shape[1], style), shape[0] * _PANEL_IN + 0.6))
    panels = list(figure.subplots(*shape, sharex="all", sharey="col", squeeze=False).flat)
    own = {codec: style.of_codec(codec) for codec in style.ordered_codecs(metrics["codec"])}
    others = _greyed(style.ordered_codecs(reference["codec"]), style)
    for number, axes in enumerate(panels):
        dataset, quality = datasets[number // shape[1]], qualities[number % shape[1]]
        _set_axes(axes, quality)
        for table, styles, above in ((reference, others, 2), (metrics, own, 4)):
            rows = table[table["dataset"] == dataset]
            for codec, look in styles.items():
                known = rows[rows["codec"] == codec].dropna(subset=[quality])
                _draw(axes, known, quality, look, above, style)
        set_title(axes, style.title(dataset), shape[1], style)
    label_outer(panels, shape[1], "Bits per point", "")
    for number, axes in enumerate(panels):
        axes.set_ylabel(_label(qualities[number % shape[1]], peak))
    handles = [_handle(look, look.title, 4, style) for look in own.values()]
    handles += [_handle(look, f"{look.title}, {study}", 2, style) for look in others.values()]
    handles += [lossless_handle()] if lossless_rows(metrics).any() else []
    longest = max(len(str(handle.get_label())) for handle in handles)
    abreast = figure.get_size_inches()[0] / (longest * 0.58 * style.font_size / 72 + 0.5)
    add_rows_legend(figure, handles, int(abreast))
    return figure


def _label(quality: str, peak: str) -> str:
    """Name of a vertical axis; a PSNR's has its peak."""
    name = _LABELS.get(quality, quality)
    return f"{name}\n{peak}" if quality in WITH_PEAK and peak else name


def _greyed(codecs: Sequence[str], style: FigureStyle) -> dict[str, PlotStyle]:
    """The codecs' styles in grey; their markers tell them apart."""
    return {
        codec: replace(style.of_codec(codec), colour=_GREYS[number % len(_GREYS)])
        for number, codec in enumerate(codecs)
    }


def _set_axes(axes: Axes, quality: str) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=12))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    if not quality.endswith("_psnr"):
        axes.set_yscale("log")
    axes.grid(which="minor", axis="x", linewidth=0.25, color="#ececec")


def _draw(
    axes: Axes, rows: pd.DataFrame, quality: str, look: PlotStyle, above: int, style: FigureStyle
) -> None:
    if rows.empty:
        return
    bpp, values = medians_against(rows, "bpp", quality)
    is_psnr = quality.endswith("_psnr")
    is_exact = values > MOST_DB if is_psnr else values == 0
    shown = np.isfinite(values) & ~is_exact
    line = _line(look, above, style)
    axes.plot(bpp[shown], values[shown], zorder=above, **line)
    if is_exact.any():
        edge = np.full(np.count_nonzero(is_exact), 1.0 if is_psnr else 0.0)
        hollow = {**line, "linestyle": "", "markerfacecolor": "white", "clip_on": False}
        axes.plot(bpp[is_exact], edge, zorder=above, transform=axes.get_xaxis_transform(), **hollow)


def _line(look: PlotStyle, above: int, style: FigureStyle) -> dict[str, Any]:
    return {
        "color": look.colour,
        "marker": look.marker,
        "linestyle": look.line,
        "linewidth": style.line_width * (1.6 if above > 2 else 0.8),
        "markersize": style.marker_size * (1.2 if above > 2 else 0.9),
    }


def _handle(look: PlotStyle, label: str, above: int, style: FigureStyle) -> Line2D:
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **_line(look, above, style))

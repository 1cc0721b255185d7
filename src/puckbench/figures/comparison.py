"""Curves of one's own codecs beside those of reference results, which are grey."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.figures.binning import medians_against
from puckbench.figures.panels import add_rows_legend, figure_width, label_outer, set_title
from puckbench.figures.plot_styles import PlotStyle
from puckbench.figures.style import FigureStyle

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
        Columns that are drawn upwards; PSNRs linearly, others logarithmically.
    study
        Name of the reference results, for the legend.
    style
        Titles and order of the data sets; colours of one's own codecs.
    """
    from matplotlib.figure import Figure

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
        axes.set_ylabel(_LABELS.get(qualities[number % shape[1]], qualities[number % shape[1]]))
    handles = [_handle(look, look.title, 4, style) for look in own.values()]
    handles += [_handle(look, f"{look.title}, {study}", 2, style) for look in others.values()]
    longest = max(len(str(handle.get_label())) for handle in handles)
    abreast = figure.get_size_inches()[0] / (longest * 0.58 * style.font_size / 72 + 0.5)
    add_rows_legend(figure, handles, int(abreast))
    return figure


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
    shown = np.isfinite(values)
    if not quality.endswith("_psnr"):
        shown &= values > 0
    axes.plot(bpp[shown], values[shown], zorder=above, **_line(look, above, style))


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

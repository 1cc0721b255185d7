from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.figures.axis_labels import BPP, axis_label
from puckbench.figures.binning import Curve, medians_against
from puckbench.figures.panels import (
    add_fitting_legend,
    draw_edge_ticks,
    draw_spread,
    figure_width,
    label_outer,
    line_handle,
    lossless_tick_handle,
    set_title,
    spread_handles,
    titled,
)
from puckbench.figures.plot_styles import PlotStyle
from puckbench.figures.style import FigureStyle
from puckbench.metrics.coordinate_frames import frames_of
from puckbench.metrics.lossless import MOST_DB, lossless_rows, with_lossless_best
from puckbench.metrics.peaks import WITH_PEAK, peak_phrase, without_mixed_peaks
from puckbench.results.columns import LOWER, column_named, unit_in_frames

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PANEL_IN = 2.1


def draw_comparison(
    metrics: pd.DataFrame,
    reference: pd.DataFrame,
    qualities: Sequence[str],
    study: str,
    style: FigureStyle,
) -> Figure:
    """Draw the quality of a run's codecs and of a study's codecs against bits per point.

    The figure has a row of panels for each data set, and a column for each quality. Lines are
    medians over clouds. Thin bars are quartiles; with few scenes, there is a dot for each cloud
    instead. Ticks at the edge of a panel mark lossless rates, whose PSNR is infinite or whose error
    is zero.

    Parameters
    ----------
    metrics, reference
        Results of the run, and of the study on the same clouds.
    qualities
        Columns of the results to draw, such as ``d1_psnr``.
    study
        Name of the study in the legend.
    style
        Style of the figure.
    """
    from matplotlib.figure import Figure

    peak = peak_phrase(metrics)
    metrics, reference = (with_lossless_best(without_mixed_peaks(t)) for t in (metrics, reference))
    datasets = style.ordered_datasets(metrics["dataset"])
    shape = (len(datasets), len(qualities))
    figure = Figure(figsize=(figure_width(shape[1], style), shape[0] * _PANEL_IN + 0.6))
    panels = list(figure.subplots(*shape, sharex="all", sharey="col", squeeze=False).flat)
    run_styles, reference_styles = (
        {codec: style.of_codec(codec) for codec in style.ordered_codecs(table["codec"])}
        for table in (metrics, reference)
    )
    curves: list[Curve] = []
    for number, axes in enumerate(panels):
        dataset, quality = datasets[number // shape[1]], qualities[number % shape[1]]
        _set_axes(axes, quality)
        for table, styles, zorder in ((reference, reference_styles, 2), (metrics, run_styles, 4)):
            rows = table[table["dataset"] == dataset]
            for codec, plot_style in styles.items():
                codec_rows = rows[rows["codec"] == codec].dropna(subset=[quality])
                if len(codec_rows):
                    curves.append(medians_against(codec_rows, BPP.name, quality))
                    _draw(axes, curves[-1], quality, plot_style, zorder, style)
        title = titled(style.title(dataset), metrics[metrics["dataset"] == dataset])
        set_title(axes, title, shape[1], style)
    label_outer(panels, shape[1], axis_label(BPP), "")
    for number, axes in enumerate(panels):
        axes.set_ylabel(_label(qualities[number % shape[1]], peak, frames_of(metrics)))
    handles: list[Artist] = [
        line_handle(k.title, **_line(k, 4, style)) for k in run_styles.values()
    ]
    handles += [
        line_handle(f"{k.title}, {study}", **_line(k, 2, style)) for k in reference_styles.values()
    ]
    handles += spread_handles(curves)
    handles += [lossless_tick_handle()] if lossless_rows(metrics).any() else []
    add_fitting_legend(figure, handles, style)
    return figure


def _label(quality: str, peak: str, frames: Collection[str]) -> str:
    shown = column_named(quality)
    unit, better = unit_in_frames(shown.unit, frames), shown.better or LOWER
    label = axis_label(replace(shown, unit=unit, better=better))
    return f"{label}\n{peak}" if quality in WITH_PEAK and peak else label


def _set_axes(axes: Axes, quality: str) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=12))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    if column_named(quality).unit != "dB":
        axes.set_yscale("log")
    axes.grid(which="minor", axis="x", linewidth=0.25, color="#ececec")


def _draw(
    axes: Axes,
    curve: Curve,
    quality: str,
    plot_style: PlotStyle,
    zorder: int,
    style: FigureStyle,
) -> None:
    bpp, values = curve.x, curve.y
    is_psnr = column_named(quality).unit == "dB"
    is_exact = values > MOST_DB if is_psnr else values == 0
    is_drawn = np.isfinite(values) & ~is_exact
    line = _line(plot_style, zorder, style)
    axes.plot(bpp[is_drawn], values[is_drawn], zorder=zorder, **line)
    has_bar = is_drawn & (curve.low > 0) & ((curve.high <= MOST_DB) | (not is_psnr))
    singles = curve.singles[(curve.singles[:, 1] <= MOST_DB) | (not is_psnr)]
    bars = curve._replace(low=np.where(has_bar, curve.low, np.nan), singles=singles)
    draw_spread(axes, bars, plot_style)
    edge = 1.0 if is_psnr else 0.0
    draw_edge_ticks(axes, bpp[is_exact], plot_style, edge, alpha=line["alpha"])


def _line(plot_style: PlotStyle, zorder: int, style: FigureStyle) -> dict[str, Any]:
    return {
        "color": plot_style.colour,
        "alpha": 1.0 if zorder > 2 else 0.5,
        "marker": plot_style.marker,
        "linestyle": plot_style.line,
        "linewidth": style.line_width * (1.6 if zorder > 2 else 0.8),
        "markersize": style.marker_size * (1.2 if zorder > 2 else 0.9),
    }

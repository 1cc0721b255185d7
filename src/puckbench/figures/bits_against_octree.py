from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.errors import InputError
from puckbench.figures.axis_labels import BETTER
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import (
    add_legend,
    label_outer,
    line_handle,
    log_limits,
    panel_grid,
    panels_abreast,
    set_log,
    set_title,
    titled,
)
from puckbench.figures.plot_styles import PlotStyle
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle
from puckbench.metrics.interpolation import bits_at_error
from puckbench.metrics.statistics import MIN_SCENES
from puckbench.tables.against_octree import COMPLETE_OCTREE, OCTREE
from puckbench.tables.registry import OCTREE_AND_OTHERS, SPINS_OR_RECORDINGS

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pointkit.geometry.cloud import Floats
    from puckbench.figures.style import Range

CODE = ("puckbench.tables.against_octree",)

_ERRORS_MM = np.geomspace(0.5, 50, 61)
_MARK_EVERY = 10
_LIMITS_MM = (0.4, 60.0)
_TICKS_MM, _TICKS = (0.5, 1, 2, 5, 10, 20, 50), (5, 10, 20, 50, 100, 200, 500, 1000, 2000)
_BITS = f"Bits, relative to G-PCC's\noctree coder, {BETTER}"
_PANEL_IN = 2.1
_SHADED = 0.15
_SINGLE: dict[str, Any] = {"linewidth": 0.5, "alpha": 0.5}


@FIGURES.register(
    "handicap",
    title="Bits relative to G-PCC's octree coder at equal error",
    category="Spins of a sensor",
    needs=(SPINS_OR_RECORDINGS, OCTREE_AND_OTHERS),
    frame="metric",
)
def draw_bits_against_octree(
    metrics: pd.DataFrame, clouds: pd.DataFrame, style: FigureStyle
) -> Figure:
    """Bits of each codec, in percent of the bits of G-PCC's octree coder at equal D1 RMS error. The
    octree coder (``gpcc``) does not know the sensor. Lines are medians over n clouds, at errors
    that rates of both codecs reach. Shaded areas are quartiles; with fewer than six clouds,
    there is a thin line for each cloud instead.

    Of data sets that differ only in the error model, only the first is shown. For lossless coding,
    see the table ``against_octree``.
    """
    columns = ("dataset", "cloud", "codec", "rate", "bpp", "d1_rms_m")
    require_rows(metrics, columns, "metrics")
    require_numbers(metrics, ("bpp", "d1_rms_m"), "metrics")
    rows_mm = metrics.assign(error_mm=1000 * metrics["d1_rms_m"])
    compared = compared_datasets(rows_mm, clouds)
    datasets = [name for name in style.ordered_datasets(rows_mm["dataset"]) if name in compared]
    curves = {name: _curves(rows_mm[rows_mm["dataset"] == name], style) for name in datasets}
    if not curves:
        raise InputError(f"metrics table: no data set is coded by {OCTREE} and by another codec")
    # Data sets without a common error get no panel, unless there is no other.
    curves = {name: lines for name, lines in curves.items() if lines} or curves
    drawn = [shares for lines in curves.values() for shares in lines.values()]
    values = np.concatenate([np.array([100.0]), *map(np.ravel, drawn)])
    limits = log_limits(values, "share_of_octree", style)
    abreast = panels_abreast(len(curves))
    figure, panels = panel_grid(len(curves), abreast, _PANEL_IN, style)
    for axes, (dataset, lines) in zip(panels, curves.items(), strict=True):
        _set_axes(axes, limits)
        axes.axhline(100, color=style.of_codec(OCTREE).colour, zorder=2, linewidth=1)
        if not lines:
            axes.text(0.5, 0.5, "no equal errors", transform=axes.transAxes, ha="center")
        for codec, of_clouds in lines.items():
            _draw(axes, of_clouds, style.of_codec(codec))
        dataset_rows = rows_mm[rows_mm["dataset"] == dataset]
        set_title(axes, titled(style.title(dataset), dataset_rows), abreast, style)
    label_outer(panels, abreast, f"D1 error, RMS (mm), {BETTER}", _BITS)
    codecs = {codec for lines in curves.values() for codec in lines}
    octree = line_handle("G-PCC's octree coder, 100 %", color=style.of_codec(OCTREE).colour)
    handles = [octree]
    if any(1 < len(of_clouds) < MIN_SCENES for of_clouds in drawn):
        handles.append(line_handle("single clouds", **_SINGLE))
    if any(len(of_clouds) >= MIN_SCENES for of_clouds in drawn):
        handles.append(line_handle("quartiles over clouds", linewidth=6, alpha=_SHADED))
    add_legend(figure, style.ordered_codecs(codecs), style, handles)
    return figure


def compared_datasets(metrics: pd.DataFrame, clouds: pd.DataFrame) -> set[str]:
    """Return the data sets that the octree coder and another codec coded.

    Of data sets that differ only in the error model, only the first is returned.
    """
    other_rows = metrics[metrics["codec"] != OCTREE]
    datasets = set(metrics[metrics["codec"] == OCTREE]["dataset"]) & set(other_rows["dataset"])
    compared = clouds[clouds["dataset"].isin(datasets)]
    scan_columns = [name for name in ("cloud", "sensor", "turns", "firings") if name in compared]
    first = compared.groupby(scan_columns, dropna=False)["dataset"].transform("first")
    return set(first)


def _curves(rows: pd.DataFrame, style: FigureStyle) -> dict[str, Floats]:
    octree = rows[rows["codec"] == OCTREE]
    codecs = style.ordered_codecs(set(rows["codec"]) - {OCTREE, COMPLETE_OCTREE})
    curves = {codec: shares(rows[rows["codec"] == codec], octree) for codec in codecs}
    return {codec: curve for codec, curve in curves.items() if np.isfinite(curve).any()}


def shares(rows: pd.DataFrame, octree: pd.DataFrame) -> Floats:
    """Compare a codec's bits with those of the octree coder at equal errors.

    Parameters
    ----------
    rows, octree
        Results of the codec and of the octree coder on one data set.

    Returns
    -------
    numpy.ndarray
        Bits of the codec, in percent of the octree coder's, (clouds, errors), at errors from 0.5 to
        50 mm; nan where one of the two does not reach the error.
    """
    anchors = dict(iter(octree.groupby("cloud")))
    lines = [
        _bits_at_errors(curve) / _bits_at_errors(anchors[cloud])
        for cloud, curve in rows.groupby("cloud")
        if cloud in anchors
    ]
    return 100 * np.reshape(lines, (-1, len(_ERRORS_MM)))


def _bits_at_errors(curve: pd.DataFrame) -> Floats:
    bits = [bits_at_error(curve["bpp"], curve["error_mm"], mm) for mm in _ERRORS_MM.tolist()]
    return np.array(bits)


def _set_axes(axes: Axes, limits: Range) -> None:
    from matplotlib.ticker import FixedLocator, PercentFormatter, StrMethodFormatter

    set_log(axes, "x", _LIMITS_MM)
    set_log(axes, "y", limits, minor=False)
    axes.xaxis.set_major_locator(FixedLocator(_TICKS_MM))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_major_locator(FixedLocator(_TICKS))
    axes.yaxis.set_major_formatter(PercentFormatter(decimals=0))


def _draw(axes: Axes, of_clouds: Floats, plot_style: PlotStyle) -> None:
    low, median, high = np.quantile(of_clouds, (0.25, 0.5, 0.75), axis=0)
    colour = plot_style.colour
    if len(of_clouds) >= MIN_SCENES:
        axes.fill_between(_ERRORS_MM, low, high, color=colour, alpha=_SHADED, linewidth=0)
    elif len(of_clouds) > 1:
        axes.plot(_ERRORS_MM, of_clouds.T, color=colour, **_SINGLE)
    axes.plot(
        _ERRORS_MM, median, color=plot_style.colour, linestyle=plot_style.line,
        marker=plot_style.marker, markevery=_MARK_EVERY, zorder=3,
    )  # fmt: skip

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from puckbench.figures.axis_labels import BPP, CD_POINT, axis_label
from puckbench.figures.checks import require_rows
from puckbench.figures.panels import (
    add_fitting_legend,
    add_legend,
    line_handle,
    log_limits,
    panel_grid,
    set_log,
    set_title,
)
from puckbench.figures.plot_styles import PlotStyle
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import COLUMN_WIDTH_IN, FigureStyle
from puckbench.metrics.statistics import MIN_SCENES

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")

_figure = partial(FIGURES.register, category="Findings")
_figure_of_both = partial(_figure, needs=("rounded_and_truncated_gpcc",))
_ROWS = (BPP, CD_POINT)
_SCALE = "Scale (small markers: no power of two)"
_SMALL = 0.55
"""Relative size of markers at scales that are not powers of two.

Such markers are small because some shapes cannot be hollow.
"""
_COLUMNS = ("dataset", "codec", "scale", "dyadic")
_SHADED = 0.2
_MOST_NAMES = 6
"""Number of scales that have names along an axis at most; of more, every second has."""


@_figure("gpcc_grid", title="G-PCC's bits and distortion against the scale of its grid")
def draw_scales(gpcc_scales: pd.DataFrame, style: FigureStyle) -> Figure:
    """G-PCC's bits per point and Chamfer distance (point-to-point) against the scale of its grid.

    Lines are medians over n clouds. Small markers are scales that are not powers of two. With
    truncated coordinates, the distance rises from scale 1/2 to 5/8. The thesis lacks this figure.
    """
    require_rows(gpcc_scales, (*_COLUMNS, "bpp", "cd_point"), "scales")
    datasets = style.ordered_datasets(gpcc_scales["dataset"])
    figure, panels = panel_grid(2 * len(datasets), len(datasets), 1.9, style, sharey="row")
    for index, axes in enumerate(panels):
        metric, dataset = _ROWS[index // len(datasets)], datasets[index % len(datasets)]
        rows = gpcc_scales[gpcc_scales["dataset"] == dataset]
        values = gpcc_scales[metric.name].to_numpy(dtype=float)
        set_log(axes, "y", log_limits(values, metric.name, style), minor=False)
        for codec in style.ordered_codecs(rows["codec"]):
            look = style.of_codec(codec)
            _draw(axes, rows[rows["codec"] == codec], metric.name, look, "_none")
        _set_scales(axes, gpcc_scales["scale"].to_numpy(dtype=float))
        if index < len(datasets):
            set_title(axes, _counted(rows, style), len(datasets), style)
        if index % len(datasets) == 0:
            axes.set_ylabel(axis_label(metric, 2))
    figure.supxlabel(_SCALE, fontsize=style.font_size)
    add_legend(figure, style.ordered_codecs(gpcc_scales["codec"]), style)
    return figure


@_figure_of_both("gpcc_rounding", title="What truncated coordinates cost G-PCC in distortion")
def draw_rounding(gpcc_scales: pd.DataFrame, style: FigureStyle) -> Figure:
    """G-PCC's Chamfer distance (point-to-point) with truncated coordinates, divided by that with
    rounded coordinates.

    Lines are medians over n clouds, by scale of the grid. Shaded areas are quartiles of six clouds
    or more. Truncation shifts the cloud, except at scales 1/2, 1/4, 1/8 and so on. The thesis
    truncates coordinates, and lacks this figure.
    """
    label = "CD with truncated over CD with\nrounded coordinates"
    return _draw_ratio(gpcc_scales, "distortion", label, style)


@_figure_of_both("gpcc_contexts", title="What neighbour contexts save G-PCC in bits")
def draw_contexts(gpcc_scales: pd.DataFrame, style: FigureStyle) -> Figure:
    """G-PCC's bits with TMC13's default tools, divided by bits with the tools of MPEG's test
    conditions.

    Lines are medians over n clouds, by scale of the grid. Shaded areas are quartiles of six clouds
    or more. The default tools, which the thesis uses, lack contexts of neighbours beyond the parent
    node, and intra prediction. At scales that are not powers of two, truncated coordinates matter
    too. The thesis lacks this figure.
    """
    label = "Bits with TMC13's defaults over bits\nwith all contexts of neighbours"
    return _draw_ratio(gpcc_scales, "bits", label, style)


def _counted(rows: pd.DataFrame, style: FigureStyle) -> str:
    return f"{style.title(rows['dataset'].iloc[0])} (n = {rows['clouds'].max()})"


def _draw_ratio(table: pd.DataFrame, name: str, label: str, style: FigureStyle) -> Figure:
    from matplotlib.figure import Figure

    columns = tuple(f"{name}_{suffix}" for suffix in ("q25", "median", "q75"))
    rows = table[table["role"] == "gpcc_as_run"].dropna(subset=list(columns))
    if rows.empty:
        raise InputError("scales table: no scale that both G-PCC codecs have")
    figure = Figure(figsize=(style.width_in or COLUMN_WIDTH_IN, 2.8))
    axes = figure.subplots()
    for dataset, look in style.of_datasets(table["dataset"]).items():
        dataset_rows = rows[rows["dataset"] == dataset].sort_values("scale")
        if dataset_rows.empty:
            continue
        many = dataset_rows[dataset_rows["clouds"] >= MIN_SCENES]
        ends = many[columns[0]], many[columns[2]]
        axes.fill_between(many["scale"], *ends, color=look.colour, alpha=_SHADED, linewidth=0)
        _draw(axes, dataset_rows, columns[1], look, _counted(dataset_rows, style))
    axes.axhline(1, color="#555555", linewidth=0.7)
    _set_scales(axes, rows["scale"].to_numpy(dtype=float))
    axes.set_xlabel(_SCALE)
    axes.set_ylabel(label)
    handles, _ = axes.get_legend_handles_labels()
    if (rows["clouds"] >= MIN_SCENES).any():
        handles.append(line_handle("quartiles over clouds", linewidth=6, alpha=_SHADED))
    add_fitting_legend(figure, handles, style)
    return figure


def _draw(axes: Axes, rows: pd.DataFrame, column: str, look: PlotStyle, label: str) -> None:
    import matplotlib

    rows = rows.sort_values("scale")
    scale, y = rows["scale"].to_numpy(), rows[column].to_numpy(float)
    is_dyadic = rows["dyadic"].to_numpy(bool)
    line: dict[str, Any] = {"color": look.colour, "marker": look.marker}
    dyadic = np.flatnonzero(is_dyadic).tolist()
    axes.plot(scale, y, linestyle=look.line, markevery=dyadic, label=label, **line)
    size = _SMALL * matplotlib.rcParams["lines.markersize"]
    axes.plot(scale[~is_dyadic], y[~is_dyadic], linestyle="", markersize=size, **line)


def _set_scales(axes: Axes, scales: Floats) -> None:
    from matplotlib.ticker import NullLocator

    axes.set_xscale("log", base=2)
    low, high = (int(f(np.log2(v))) for f, v in ((np.floor, scales.min()), (np.ceil, scales.max())))
    powers = range(low, high + 1)
    every = 1 if len(powers) <= _MOST_NAMES else 2  # all names would touch
    names = [f"1/{2**-power}" if power < 0 else f"{2**power}" for power in powers]
    shown = [name if power % every == 0 else "" for power, name in zip(powers, names, strict=True)]
    axes.set_xticks([2.0**power for power in powers], shown)
    axes.xaxis.set_minor_locator(NullLocator())

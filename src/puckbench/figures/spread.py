from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.geometry.cloud import Floats
from puckbench.figures.axis_labels import CD_PLANE, axis_label
from puckbench.figures.binning import ordered_rates
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import (
    label_rates,
    log_limits,
    panel_grid,
    set_log,
    set_title,
    titled,
    wrapped,
)
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle
from puckbench.metrics.statistics import MIN_SCENES

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


@FIGURES.register(
    "spread",
    title="Spread of the Chamfer distance over clouds, per codec and rate",
    category="Results per rate",
)
def draw_spread(metrics: pd.DataFrame, style: FigureStyle) -> Figure:
    """Spread of the Chamfer distance (point to plane, squared grid units) over n clouds, for each
    codec (rows), data set (columns) and rate of the codec. Boxes are medians and quartiles, and
    whiskers are the 5 and 95 % quantiles. With fewer than six clouds, there is a circle for each
    cloud, and a line for the medians.

    Distances of zero (lossless) are not drawn.
    """
    require_rows(metrics, ("dataset", "cloud", "codec", "rate", CD_PLANE.name), "metrics")
    require_numbers(metrics, (CD_PLANE.name,), "metrics")
    datasets = style.ordered_datasets(metrics["dataset"])
    codecs = style.ordered_codecs(metrics["codec"])
    rates = {codec: ordered_rates(part["rate"]) for codec, part in metrics.groupby("codec")}
    measured = metrics[metrics["cd_plane"] > 0]
    limits = log_limits(_extremes(measured), "cd_plane", style)
    shape = len(codecs) * len(datasets), len(datasets)
    figure, panels = panel_grid(*shape, 1.2, style, sharex="row")
    for index, axes in enumerate(panels):
        codec, dataset = codecs[index // len(datasets)], datasets[index % len(datasets)]
        set_log(axes, "y", limits, minor=False)
        rows = measured[(measured["dataset"] == dataset) & (measured["codec"] == codec)]
        _draw_panel(axes, rows, rates[codec], style.of_codec(codec).colour)
        label_rates([axes], rates[codec], len(datasets))
        if index < len(datasets):
            of_dataset = metrics[metrics["dataset"] == dataset]
            set_title(axes, titled(style.title(dataset), of_dataset), len(datasets), style)
        if index % len(datasets) == 0:
            axes.set_ylabel(wrapped(style.of_codec(codec).title, 1.0, style), fontweight="bold")
    figure.supylabel(axis_label(CD_PLANE), fontsize=style.font_size)
    figure.supxlabel("Compression rate of the codec", fontsize=style.font_size)
    return figure


def _extremes(metrics: pd.DataFrame) -> Floats:
    groups = metrics.groupby(["dataset", "codec", "rate"])["cd_plane"]
    drawn_as_points = metrics.loc[groups.transform("size") < MIN_SCENES, "cd_plane"]
    whisker_ends = groups.quantile(np.array([_QUANTILES[0], _QUANTILES[-1]]))
    return np.concatenate(
        [drawn_as_points.to_numpy(dtype=float), whisker_ends.to_numpy(dtype=float)]
    )


def _draw_panel(axes: Axes, rows: pd.DataFrame, rates: list[str], colour: str) -> None:
    if rows.empty:
        axes.text(0.5, 0.5, "no values", transform=axes.transAxes, ha="center", va="center")
        return
    positions = rows["rate"].map(rates.index)
    values = rows["cd_plane"]
    if positions.value_counts().max() < MIN_SCENES:
        medians = values.groupby(positions).median()
        axes.plot(medians.index, medians, color=colour, linewidth=0.7)
        axes.plot(positions, values, "o", color=colour, markerfacecolor="none", markeredgewidth=0.8)
    else:
        _draw_boxes(
            axes, values.groupby(positions).quantile(np.array(_QUANTILES)).unstack(), colour
        )


def _draw_boxes(axes: Axes, quantiles: pd.DataFrame, colour: str) -> None:
    keys = ("whislo", "q1", "med", "q3", "whishi")
    boxes: list[dict[str, Any]] = [
        dict(zip(keys, row, strict=True)) for row in quantiles.itertuples(index=False)
    ]
    line = {"color": colour, "linewidth": 0.8}
    axes.bxp(
        boxes,
        positions=quantiles.index.to_numpy(dtype=float),
        widths=0.6,
        showfliers=False,
        patch_artist=True,
        boxprops={"facecolor": colour, "edgecolor": colour, "linewidth": 0.8},
        medianprops={"color": "#000000", "linewidth": 0.8},
        whiskerprops=line,
        capprops=line,
        manage_ticks=False,
    )

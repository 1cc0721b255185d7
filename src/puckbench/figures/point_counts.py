from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import add_rows_legend, figure_width, wrapped
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle
from puckbench.metrics.statistics import MIN_SCENES

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FEW = 12
_MEDIAN: dict[str, Any] = {"color": "black", "linewidth": 1.8}
_MEAN: dict[str, Any] = {"marker": "^", "markersize": 3.5, "mfc": "white", "mec": "black"}
_CLOUD: dict[str, Any] = {"mfc": "none", "mec": "#777777", "mew": 0.5}


@FIGURES.register("point_counts", title="Point counts per data set", category="Clouds")
def draw_point_counts(clouds: pd.DataFrame, style: FigureStyle) -> Figure:
    """Number of points per cloud in each data set.

    Boxes are quartiles of six clouds or more. Whiskers extend to the farthest cloud within 1.5
    interquartile ranges of the box; clouds beyond are not drawn. In small data sets, there is a
    circle for each cloud. n is the number of clouds.
    """
    from matplotlib.figure import Figure

    require_rows(clouds, ("dataset", "points"), "clouds")
    require_numbers(clouds, ("points",), "clouds")
    datasets = style.ordered_datasets(clouds["dataset"])
    counts = [clouds.loc[clouds["dataset"] == d, "points"].dropna().to_numpy() for d in datasets]
    width = figure_width(1 if len(datasets) <= 4 else 2, style)
    figure = Figure(figsize=(width, 2.4))
    axes = figure.subplots()
    for place, values in enumerate(counts, start=1):
        _draw_counts(axes, place, values)
    fit = (width - 0.6) / len(datasets)
    titles = [
        f"{wrapped(style.title(d), fit, style)}\n(n = {len(values)})"
        for d, values in zip(datasets, counts, strict=True)
    ]
    axes.set_xticks(range(1, len(datasets) + 1), titles)
    _label_counts(axes)
    add_rows_legend(figure, _key([len(values) for values in counts]), 4)
    return figure


def _key(clouds: list[int]) -> list[Artist]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    box = Patch(facecolor="none", edgecolor="black", linewidth=0.8, label="quartiles")
    marks: list[Artist] = [
        *([box] if max(clouds) >= MIN_SCENES else []),
        Line2D([], [], label="median", **_MEDIAN),
        Line2D([], [], linestyle="", label="mean", **_MEAN),
    ]
    if min(clouds) <= _FEW:
        marks.append(Line2D([], [], marker="o", ls="", label="cloud", **_CLOUD))
    return marks


def _draw_counts(axes: Axes, place: int, values: np.ndarray) -> None:
    if len(values) <= _FEW:
        axes.plot(np.full(len(values), place), values, "o", **_CLOUD)
    lines: dict[str, Any] = {
        name: {"linewidth": 0.8} for name in ("boxprops", "whiskerprops", "capprops")
    }
    has_box = len(values) >= MIN_SCENES
    means: dict[str, Any] = {"showmeans": True, "medianprops": _MEDIAN, "meanprops": _MEAN}
    axes.boxplot(
        [values], positions=[place], widths=0.5, manage_ticks=False,
        showfliers=False, showbox=has_box, showcaps=has_box, whis=1.5 if has_box else 0,
        **means, **lines,
    )  # fmt: skip


def _label_counts(axes: Axes) -> None:
    from matplotlib.ticker import EngFormatter

    axes.set_ylabel("Number of points per cloud")
    axes.yaxis.set_major_formatter(EngFormatter(sep=" "))
    axes.set_ylim(0, 1.08 * axes.dataLim.ymax)  # so that no marker lies on the frame

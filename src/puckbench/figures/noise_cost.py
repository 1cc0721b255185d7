from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from puckbench.figures.axis_labels import BETTER
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import add_fitting_legend, line_handle, set_title
from puckbench.figures.plot_styles import error_model_colour
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import COLUMN_WIDTH_IN, FigureStyle
from puckbench.metrics.statistics import MIN_SCENES, SCENE, with_scenes
from puckbench.tables.noise_bits import noise_bits
from puckbench.tables.registry import SEVERAL_NOISES
from virtual_lidar.errors import error_model_title

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CODE = ("puckbench.tables.noise_bits",)

_PANELS = {"grid_1_mm": "lossless, or 1 mm", "at_5_mm": "D1 error of 5 mm"}
_MARKERS = "osD^vP"
_JOINED: dict[str, Any] = {"color": "#bbbbbb", "linewidth": 1.2}
_INTERVAL: dict[str, Any] = {"color": "#222222", "linewidth": 0.8}
_LINE_IN, _AROUND_IN = 0.145, 1.1
"""Height of a codec's line, and height of the figure without these lines, in inches."""

Line = tuple[str, Floats]
"""Label of a codec, and its bits per return under each error model, (3, models): lower end of the
interval, mean, and upper end.
"""


@FIGURES.register(
    "noise_cost",
    title="Bits that the sensor's noise costs",
    category="Spins of a sensor",
    needs=(SEVERAL_NOISES,),
    frame="metric",
)
def draw_noise_cost(metrics: pd.DataFrame, clouds: pd.DataFrame, style: FigureStyle) -> Figure:
    """Bits per return that codecs need for the same rays under several error models of the sensor.
    There are panels for each set of scenes: bits without loss or on a grid of 1 mm, and bits at
    a D1 RMS error of 5 mm, if a codec reaches this error. Markers are means over n scenes, and
    grey lines join the error models of a codec. Black lines are 95 % intervals of the means of
    six scenes or more. Only data sets with the most error models are shown and, among these,
    those with the most scenes.

    The first line is the entropy of the model's noise at the sensor's range resolution. It is a
    lower bound for codecs that keep ranges exactly. It excludes the mean error of each laser in
    each turn (revolution of the sensor), which a codec can learn.
    """
    from matplotlib.figure import Figure

    require_rows(metrics, ("dataset", "cloud", "codec", "rate", "bpp", "d1_rms_m"), "metrics")
    require_rows(clouds, ("dataset", "cloud"), "clouds")
    require_numbers(metrics, ("bpp", "d1_rms_m"), "metrics")
    bits = noise_bits(metrics, clouds)
    bits = bits[bits["models"] == bits["models"].max()]
    bits = bits[bits["scenes"] == bits["scenes"].max()]
    models = bits.groupby("error_model")["noise_bits"].mean().sort_values(kind="stable").index
    markers = _markers(list(models))
    panels = [panel for group in _groups(bits, clouds, style) for panel in _panels(group, style)]
    if not panels:
        raise InputError("metrics table: no codec reaches a grid of 1 mm or a D1 error of 5 mm")
    scenes = int(bits["scenes"].max())
    heights = [len(lines) + 1.5 for _, lines in panels]
    height_in = _LINE_IN * sum(heights) + _AROUND_IN
    figure = Figure(figsize=(style.width_in or COLUMN_WIDTH_IN, height_in))
    drawn = figure.subplots(len(panels), 1, height_ratios=heights, squeeze=False, sharex=True)
    for axes, (title, lines) in zip(drawn[:, 0], panels, strict=True):
        _draw_lines(axes, lines, list(markers.values()), scenes >= MIN_SCENES)
        set_title(axes, title, 1, style)
    drawn[0, 0].set_xlim(left=-0.02 * drawn[0, 0].get_xlim()[1])
    drawn[-1, 0].set_xlabel(f"Bits per return, {BETTER}")
    handles = [line_handle(error_model_title(name), **mark) for name, mark in markers.items()]
    handles.append(line_handle("range of the models", **_JOINED))
    if scenes >= MIN_SCENES:
        handles.append(line_handle("95 % interval", **_INTERVAL))
    add_fitting_legend(figure, handles, style)
    return figure


def _markers(models: list[str]) -> dict[str, dict[str, Any]]:
    return {
        model: {
            "color": error_model_colour(model),
            "marker": _MARKERS[position % len(_MARKERS)],
            "linestyle": "",
            "markeredgecolor": "#222222",
            "markeredgewidth": 0.4,
        }
        for position, model in enumerate(models)
    }


def _groups(
    bits: pd.DataFrame, clouds: pd.DataFrame, style: FigureStyle
) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield the title and the rows of each group of data sets that have the same scenes."""
    scenes = with_scenes(clouds).groupby("dataset")[SCENE].agg(frozenset)
    names = style.ordered_datasets(bits["dataset"])
    for group in dict.fromkeys(scenes[name] for name in names):
        same = [name for name in names if scenes[name] == group]
        yield style.title(same[0]).partition(",")[0], bits[bits["dataset"].isin(same)]


def _panels(
    group: tuple[str, pd.DataFrame], style: FigureStyle
) -> Iterator[tuple[str, list[Line]]]:
    title, bits = group
    noise = bits.groupby("error_model")["noise_bits"].mean().sort_values(kind="stable")
    entropy: Line = ("entropy of the noise", np.tile(noise.to_numpy(float), (3, 1)))
    for column, words in _PANELS.items():
        if lines := _lines(bits, column, list(noise.index), style):
            first = [entropy] if column == next(iter(_PANELS)) else []
            yield f"{title}: {words} (n = {int(bits['scenes'].max())})", [*first, *lines]


def _lines(bits: pd.DataFrame, column: str, models: list[str], style: FigureStyle) -> list[Line]:
    low, values, high = (
        bits.groupby(["codec", "error_model"])[name].mean().unstack().reindex(columns=models)
        for name in (f"{column}_low", column, f"{column}_high")
    )
    order = values.dropna(how="all").median(axis=1).sort_values(kind="stable").index
    return [
        (style.of_codec(codec).title, np.array([t.loc[codec] for t in (low, values, high)], float))
        for codec in order
    ]


def _draw_lines(
    axes: Axes, lines: list[Line], markers: list[dict[str, Any]], intervals: bool
) -> None:
    positions = np.arange(len(lines))
    for position, (_, (low, values, high)) in zip(positions, lines, strict=True):
        axes.plot([np.nanmin(values), np.nanmax(values)], [position, position], **_JOINED)
        if intervals:
            axes.hlines([position] * len(low), low, high, zorder=4, **_INTERVAL)
    for number, marker in enumerate(markers):
        axes.plot([values[1, number] for _, values in lines], positions, zorder=3, **marker)
    axes.set_yticks(positions, [name for name, _ in lines])
    axes.set_ylim(len(lines) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", linewidth=0.4, alpha=0.6)
    axes.grid(visible=False, axis="y")

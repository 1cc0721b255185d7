"""What a sensor's noise costs in bits, codec by codec."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import add_rows_legend, set_title
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import COLUMN_WIDTH_IN, FigureStyle
from puckbench.geometry.cloud import Floats
from puckbench.metrics.table_registry import SEVERAL_NOISES
from puckbench.metrics.tables.noise_bits import noise_bits

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PANELS = {"grid_1_mm": "Exact, or on a grid of 1 mm", "at_5_mm": "At an error (D1) of 5 mm"}
_MARKERS = "osD^vP"
_LINE_IN, _AROUND_IN = 0.145, 1.1
"""Height of a codec's line, and of what is around the lines, in inches."""

Line = tuple[str, Floats]
"""What a line shows, and its value under each error model."""


@FIGURES.register(
    "noise_cost",
    title="What the sensor's noise costs in bits",
    category="Spins of a sensor",
    needs=(SEVERAL_NOISES,),
    frame="metric",
)
def draw_noise_cost(metrics: pd.DataFrame, clouds: pd.DataFrame, style: FigureStyle) -> Figure:
    """Bits per return of the same rays and surfaces under the sensor's error models, medians over
    the clouds. Above: exact, or without loss on a grid of 1 mm. Below: at a root mean square error
    (D1) of 5 mm. Codecs whose rates do not reach that are not shown.

    First line: the entropy of the noise that the model added, in steps of the sensor's ranges. No
    exact codec can need less; what lies beyond is the cost of the scene, and of what a codec does
    not know about the sensor. (The mean error of each laser in each turn is not counted as noise: a
    codec can learn it.)
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    require_rows(metrics, ("dataset", "cloud", "codec", "rate", "bpp", "d1_rms_m"), "metrics")
    require_rows(clouds, ("dataset", "cloud"), "clouds")
    require_numbers(metrics, ("bpp", "d1_rms_m"), "metrics")
    bits = noise_bits(metrics, clouds)
    bits = bits[bits["models"] == bits["models"].max()]
    noise = bits.groupby("error_model")["noise_bits"].median().sort_values(kind="stable")
    looks = _looks(list(noise.index))
    found = [_lines(bits, column, list(noise.index), style) for column in _PANELS]
    if not any(found):
        raise InputError("metrics table: no codec is exact, on a grid of 1 mm, or at 5 mm (D1)")
    found[0].insert(0, ("entropy of the noise", noise.to_numpy(float)))
    heights = [len(lines) + 1 for lines in found]
    height_in = _LINE_IN * sum(heights) + _AROUND_IN
    figure = Figure(figsize=(style.width_in or COLUMN_WIDTH_IN, height_in))
    panels = figure.subplots(2, 1, height_ratios=heights)
    for axes, lines, title in zip(panels, found, _PANELS.values(), strict=True):
        _draw_lines(axes, lines, list(looks.values()))
        set_title(axes, title, 1, style)
    panels[-1].set_xlabel("Bits per return")
    handles = [Line2D([], [], label=name, **look) for name, look in looks.items()]
    add_rows_legend(figure, handles, 3)
    return figure


def _looks(models: list[str]) -> dict[str, dict[str, Any]]:
    """How each error model is shown: from dark to light by its noise, each with its own marker."""
    from matplotlib import colormaps

    colours = colormaps["viridis"](np.linspace(0, 0.92, len(models)))
    return {
        model: {
            "color": tuple(colour),
            "marker": _MARKERS[place % len(_MARKERS)],
            "linestyle": "",
            "markeredgecolor": "#222222",
            "markeredgewidth": 0.4,
        }
        for place, (model, colour) in enumerate(zip(models, colours, strict=True))
    }


def _lines(bits: pd.DataFrame, column: str, models: list[str], style: FigureStyle) -> list[Line]:
    """Codecs that have the bits, by their median over the models."""
    table = bits.pivot_table(
        index="codec", columns="error_model", values=column, aggfunc="median"
    ).reindex(columns=models)
    table = table.dropna(how="all")
    order = table.median(axis=1).sort_values(kind="stable").index
    return [(style.of_codec(codec).title, table.loc[codec].to_numpy(float)) for codec in order]


def _draw_lines(axes: Axes, lines: list[Line], looks: list[dict[str, Any]]) -> None:
    places = np.arange(len(lines))
    for place, (_, values) in zip(places, lines, strict=True):
        axes.plot(
            [np.nanmin(values), np.nanmax(values)], [place, place], color="#bbbbbb", linewidth=1.2
        )
    for number, look in enumerate(looks):
        axes.plot([values[number] for _, values in lines], places, zorder=3, **look)
    axes.set_yticks(places, [name for name, _ in lines])
    axes.set_ylim(len(lines) - 0.4, -0.6)
    axes.set_xlim(left=-0.02 * axes.get_xlim()[1])
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", linewidth=0.4, alpha=0.6)
    axes.grid(visible=False, axis="y")

"""Panels on logarithmic axes with shared limits and one legend per figure."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from puckbench.figures.plot_styles import PlotStyle
from puckbench.figures.style import COLUMN_WIDTH_IN, PAGE_WIDTH_IN, FigureStyle, Range
from puckbench.geometry.cloud import Floats

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

Sharing = Literal["all", "row"]
SCAN_LINE: dict[str, Any] = {"color": "#444444", "linestyle": (0, (4, 2)), "linewidth": 0.9}
"""Line style for the value of an uncoded scan."""
_MARGIN = 1.4
"""Factor between the outermost values and fitted limits."""
_MOST_NAMES, _MOST_NUMBERS = 36, 60
"""Maximum number of rates in a row of panels for labels r1, r2, ..., and for labels 1, 2, ..."""


def panel_grid(
    panels: int, columns: int, height_in: float, style: FigureStyle, sharey: Sharing = "all"
) -> tuple[Figure, list[Axes]]:
    """Create a figure with panels of `height_in` inches, `columns` in a row, and shared axes."""
    from matplotlib.figure import Figure

    rows = math.ceil(panels / columns)
    figure = Figure(figsize=(figure_width(columns, style), rows * height_in + 0.45))
    grid = figure.subplots(rows, columns, sharex="all", sharey=sharey, squeeze=False)
    placed = list(grid.flat)
    for axes in placed[panels:]:
        axes.remove()
    for axes in placed[max(0, panels - columns) : panels]:
        axes.tick_params(labelbottom=True)
    return figure, placed[:panels]


def figure_width(columns: int, style: FigureStyle) -> float:
    return style.width_in or (COLUMN_WIDTH_IN if columns == 1 else PAGE_WIDTH_IN)


def panels_abreast(panels: int) -> int:
    """Return the number of panels in a row: two for four panels, as in the thesis."""
    return {1: 1, 2: 2, 3: 3, 4: 2, 5: 3, 6: 3}.get(panels, 4)


def log_limits(values: Floats, default: Range) -> Range:
    """Return a default range, widened by whole decades to contain every positive value."""
    positive = values[np.isfinite(values) & (values > 0)]
    if len(positive) == 0:
        return default
    low, high = float(positive.min()), float(positive.max())
    if low < default[0]:
        default = (10.0 ** math.floor(math.log10(low)), default[1])
    if high > default[1]:
        default = (default[0], 10.0 ** math.ceil(math.log10(high)))
    return default


def fitted_limits(values: Floats, default: Range) -> Range:
    """Return limits slightly beyond the positive values, or `default` if there are none."""
    positive = values[np.isfinite(values) & (values > 0)]
    if len(positive) == 0:
        return default
    return float(positive.min()) / _MARGIN, float(positive.max()) * _MARGIN


def draw_line(axes: Axes, x: Floats, y: Floats, plot_style: PlotStyle, floor: float) -> None:
    """Draw a codec's line; zeros (lossless) become hollow markers at the lower limit `floor`."""
    clipped = np.maximum(y, floor)
    style: dict[str, Any] = {
        "color": plot_style.colour,
        "marker": plot_style.marker,
        "clip_on": False,
        "zorder": 3,
    }
    axes.plot(x, clipped, linestyle=plot_style.line, markeredgewidth=0.6, **style)
    zero = y == 0
    if zero.any():
        axes.plot(x[zero], clipped[zero], linestyle="", markerfacecolor="white", **style)


def scan_handle() -> Line2D:
    from matplotlib.lines import Line2D

    return Line2D([], [], label="the scan itself", **SCAN_LINE)


def lossless_handle() -> Line2D:
    from matplotlib.lines import Line2D

    hollow: dict[str, Any] = {
        "color": "#444444",
        "linestyle": "",
        "marker": "o",
        "markerfacecolor": "white",
    }
    return Line2D([], [], label="lossless", **hollow)


def draw_over_rates(axes: Axes, y: Floats, plot_style: PlotStyle, floor: float) -> None:
    """Draw a codec's values (rates,) at equidistant positions; nan leaves a gap."""
    present = np.flatnonzero(np.isfinite(y))
    if len(present):
        positions = np.arange(present[0], present[-1] + 1)
        draw_line(axes, positions.astype(float), y[positions], plot_style, floor)


def label_rates(panels: Sequence[Axes], rates: Sequence[str], abreast: int) -> None:
    """Label the rates r1, r2, ... or, if space is short, 1, 2, ..."""
    density = len(rates) * abreast
    names = rates if density <= _MOST_NAMES else [rate.removeprefix("r") for rate in rates]
    step = math.ceil(density / _MOST_NUMBERS)
    for axes in panels:
        axes.set_xlim(-0.5, len(rates) - 0.5)
        axes.set_xticks(range(0, len(rates), step), names[::step])


def set_log(axes: Axes, axis: Literal["x", "y"], limits: Range, minor: bool = True) -> None:
    """Make an axis logarithmic, with ticks at decades and, on short axes, at 2 and 5 times these.

    `minor` adds grid lines within decades.
    """
    from matplotlib.ticker import LogLocator, NullFormatter, NullLocator, StrMethodFormatter

    line = axes.xaxis if axis == "x" else axes.yaxis
    getattr(axes, f"set_{axis}scale")("log")
    getattr(axes, f"set_{axis}lim")(*limits)
    line.set_major_locator(LogLocator(numticks=12))
    if math.floor(math.log10(limits[1])) <= math.ceil(math.log10(limits[0])):
        line.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=12))
        line.set_major_formatter(StrMethodFormatter("{x:g}"))
    inside = LogLocator(subs=list(range(2, 10)), numticks=12) if minor else NullLocator()
    line.set_minor_locator(inside)
    line.set_minor_formatter(NullFormatter())
    axes.grid(which="minor", axis=axis, linewidth=0.25, color="#ececec")


def wrapped(text: str, width_in: float, style: FigureStyle) -> str:
    character_in = 0.56 * style.font_size / 72
    return textwrap.fill(text, max(6, int(width_in / character_in)), break_long_words=False)


def set_title(axes: Axes, text: str, columns: int, style: FigureStyle) -> None:
    width_in = (figure_width(columns, style) - 0.5) / columns
    axes.set_title(wrapped(text, width_in, style), pad=3)


def label_outer(panels: Sequence[Axes], columns: int, x: str, y: str) -> None:
    for axes in panels[::columns]:
        axes.set_ylabel(y)
    for column in range(min(columns, len(panels))):
        drawn = [axes for axes in panels[column::columns] if axes.axison]
        for lowest in drawn[-1:]:
            lowest.set_xlabel(x)
            lowest.tick_params(labelbottom=True)


def add_legend(
    figure: Figure, codecs: Sequence[str], style: FigureStyle, extra_handles: Sequence[Artist] = ()
) -> None:
    handles = [*codec_handles(codecs, style), *extra_handles]
    widest_in = max(len(str(h.get_label())) for h in handles) * 0.58 * style.font_size / 72 + 0.5
    add_rows_legend(figure, handles, int(figure.get_size_inches()[0] / widest_in))


def codec_handles(codecs: Sequence[str], style: FigureStyle) -> list[Line2D]:
    from matplotlib.lines import Line2D

    lines = [style.of_codec(codec) for codec in codecs]
    return [
        Line2D([], [], color=k.colour, marker=k.marker, ls=k.line, label=k.title) for k in lines
    ]


def add_rows_legend(
    figure: Figure, handles: Sequence[Artist], most_abreast: int, **options: Any
) -> None:
    """Add a legend above all panels, in rows of at most `most_abreast` entries."""
    rows = math.ceil(len(handles) / max(1, most_abreast))
    abreast = math.ceil(len(handles) / rows)
    by_column = [handle for column in range(abreast) for handle in handles[column::abreast]]
    figure.legend(handles=by_column, loc="outside upper center", ncols=abreast, **options)

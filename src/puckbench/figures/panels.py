"""Panels on logarithmic axes: shared limits, one line per codec, one legend per figure."""

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
"""Of the level of a scan itself, beside those of codecs."""
_MARGIN = 1.4
"""Factor between the outermost values and fitted limits: room for a whole marker."""
_MOST_NAMES, _MOST_NUMBERS = 36, 60
"""Rates that have room side by side on a page as r1, r2, ... and as 1, 2, ..."""


def panel_grid(
    panels: int, columns: int, height_in: float, style: FigureStyle, sharey: Sharing = "all"
) -> tuple[Figure, list[Axes]]:
    """A figure of panels with shared axes.

    Parameters
    ----------
    panels, columns
        Number in all, and in a row; places left over in the last row stay free.
    height_in
        Inches of one panel with its labels.
    style
        Gives the width, else one panel in a row is as wide as a column of text, more as the page.
    sharey
        Whether all panels share their vertical axis, or those of a row.

    Returns
    -------
    Figure, list of Axes
        The figure, and its panels row by row.
    """
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
    """Width in inches of a figure with this number of panels in a row."""
    return style.width_in or (COLUMN_WIDTH_IN if columns == 1 else PAGE_WIDTH_IN)


def panels_abreast(panels: int) -> int:
    """Number of panels in a row: four are two by two as in the thesis."""
    return {1: 1, 2: 2, 3: 3, 4: 2, 5: 3, 6: 3}.get(panels, 4)


def log_limits(values: Floats, default: Range) -> Range:
    """Limits of a logarithmic axis: a default range, widened until it holds every positive value.

    Parameters
    ----------
    values
        (n,) that are drawn; nan and zero do not count.
    default
        Low and high, which are widened by whole decades.
    """
    shown = values[np.isfinite(values) & (values > 0)]
    if len(shown) == 0:
        return default
    low, high = float(shown.min()), float(shown.max())
    if low < default[0]:
        default = (10.0 ** math.floor(math.log10(low)), default[1])
    if high > default[1]:
        default = (default[0], 10.0 ** math.ceil(math.log10(high)))
    return default


def fitted_limits(values: Floats, default: Range) -> Range:
    """Limits a little beyond the positive values.

    Parameters
    ----------
    values
        (n,) that are drawn; nan and zero do not count.
    default
        Low and high where there is no positive value.
    """
    shown = values[np.isfinite(values) & (values > 0)]
    if len(shown) == 0:
        return default
    return float(shown.min()) / _MARGIN, float(shown.max()) * _MARGIN


def draw_line(axes: Axes, x: Floats, y: Floats, plot_style: PlotStyle, floor: float) -> None:
    """Draw one codec's line; values of zero (lossless) stand hollow at the lower end of the axis.

    Markers are drawn over the frame, so that a point on the limit is whole.

    Parameters
    ----------
    axes
        The panel.
    x, y
        (n,) values.
    plot_style
        Colour, marker and line.
    floor
        Lower end of the vertical axis.
    """
    shown = np.maximum(y, floor)
    style: dict[str, Any] = {
        "color": plot_style.colour,
        "marker": plot_style.marker,
        "clip_on": False,
        "zorder": 3,
    }
    axes.plot(x, shown, linestyle=plot_style.line, markeredgewidth=0.6, **style)
    zero = y == 0
    if zero.any():
        axes.plot(x[zero], shown[zero], linestyle="", markerfacecolor="white", **style)


def scan_handle() -> Line2D:
    """What the legend shows for the scan itself."""
    from matplotlib.lines import Line2D

    return Line2D([], [], label="the scan itself", **SCAN_LINE)


def lossless_handle() -> Line2D:
    """What the legend shows for rates that lose nothing."""
    from matplotlib.lines import Line2D

    hollow: dict[str, Any] = {
        "color": "#444444",
        "linestyle": "",
        "marker": "o",
        "markerfacecolor": "white",
    }
    return Line2D([], [], label="lossless", **hollow)


def draw_over_rates(axes: Axes, y: Floats, plot_style: PlotStyle, floor: float) -> None:
    """Draw one codec's values side by side, one place for each rate.

    Parameters
    ----------
    axes
        The panel.
    y
        (rates,) values; a missing one (nan) leaves a gap.
    plot_style
        Colour, marker and line.
    floor
        Lower end of the vertical axis.
    """
    known = np.flatnonzero(np.isfinite(y))
    if len(known):
        at = np.arange(known[0], known[-1] + 1)
        draw_line(axes, at.astype(float), y[at], plot_style, floor)


def label_rates(panels: Sequence[Axes], rates: Sequence[str], abreast: int) -> None:
    """Name the rates below the panels: r1, r2, ... or, where these have no room, 1, 2, ...

    Parameters
    ----------
    panels
        Whose horizontal axes have one place for each rate.
    rates
        Names in order.
    abreast
        Number of panels in a row.
    """
    density = len(rates) * abreast
    names = rates if density <= _MOST_NAMES else [rate.removeprefix("r") for rate in rates]
    step = math.ceil(density / _MOST_NUMBERS)
    for axes in panels:
        axes.set_xlim(-0.5, len(rates) - 0.5)
        axes.set_xticks(range(0, len(rates), step), names[::step])


def set_log(axes: Axes, axis: Literal["x", "y"], limits: Range, minor: bool = True) -> None:
    """Make one axis logarithmic, with a tick and a grid line per decade; more where one is too few.

    Parameters
    ----------
    axes
        The panel.
    axis
        ``"x"`` or ``"y"``.
    limits
        Low and high.
    minor
        Whether there are lines inside the decades too, which small panels are better without.
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
    """Break a text into lines that are at most about `width_in` inches wide."""
    character_in = 0.56 * style.font_size / 72
    return textwrap.fill(text, max(6, int(width_in / character_in)), break_long_words=False)


def set_title(axes: Axes, text: str, columns: int, style: FigureStyle) -> None:
    """Set a panel's title, broken into lines that fit `columns` panels in a row."""
    width_in = (figure_width(columns, style) - 0.5) / columns
    axes.set_title(wrapped(text, width_in, style), pad=3)


def label_outer(panels: Sequence[Axes], columns: int, x: str, y: str) -> None:
    """Name the horizontal axes below the last row of panels, and the vertical ones on the left."""
    for axes in panels[::columns]:
        axes.set_ylabel(y)
    for column in range(min(columns, len(panels))):
        drawn = [axes for axes in panels[column::columns] if axes.axison]
        for lowest in drawn[-1:]:
            lowest.set_xlabel(x)
            lowest.tick_params(labelbottom=True)


def add_legend(
    figure: Figure, codecs: Sequence[str], style: FigureStyle, others: Sequence[Artist] = ()
) -> None:
    """Add one legend above all panels, in as many rows as the width asks for.

    Parameters
    ----------
    figure
        Of matplotlib.
    codecs
        In the legend's order.
    style
        Gives titles, colours and markers.
    others
        Lines or patches with a label of their own, which stand last.
    """
    handles = [*codec_handles(codecs, style), *others]
    widest_in = max(len(str(h.get_label())) for h in handles) * 0.58 * style.font_size / 72 + 0.5
    add_rows_legend(figure, handles, int(figure.get_size_inches()[0] / widest_in))


def codec_handles(codecs: Sequence[str], style: FigureStyle) -> list[Line2D]:
    """Lines of the codecs as a legend shows them: line, marker and title of each."""
    from matplotlib.lines import Line2D

    lines = [style.of_codec(codec) for codec in codecs]
    return [
        Line2D([], [], color=k.colour, marker=k.marker, ls=k.line, label=k.title) for k in lines
    ]


def add_rows_legend(
    figure: Figure, handles: Sequence[Artist], most_abreast: int, **options: Any
) -> None:
    """Add a legend above all panels, read row by row, of equally long rows as far as possible.

    Parameters
    ----------
    figure
        Of matplotlib.
    handles
        In the order of reading.
    most_abreast
        Greatest number of entries in a row.
    **options
        Of matplotlib's ``Figure.legend``.
    """
    rows = math.ceil(len(handles) / max(1, most_abreast))
    abreast = math.ceil(len(handles) / rows)
    by_column = [handle for column in range(abreast) for handle in handles[column::abreast]]
    figure.legend(handles=by_column, loc="outside upper center", ncols=abreast, **options)

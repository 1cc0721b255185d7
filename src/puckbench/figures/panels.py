from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pointkit.geometry.cloud import Floats
from puckbench.figures.binning import Curve
from puckbench.figures.plot_styles import PlotStyle
from puckbench.figures.style import COLUMN_WIDTH_IN, PAGE_WIDTH_IN, FigureStyle, Range
from puckbench.metrics.statistics import SCENE, with_scenes
from puckbench.metrics.timing import MIN_REPEATS

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

Sharing = Literal["all", "row", "col"]
SCAN_LINE: dict[str, Any] = {"color": "#444444", "linestyle": (0, (4, 2)), "linewidth": 0.9}
"""Style of the line that shows the value of a scan before coding."""
UNRANKED_LINE: dict[str, Any] = {"linestyle": ":", "linewidth": 1.2, "marker": ""}
_TICK_WIDTH, _TICK_LENGTH = 1.8, 0.07
_LEGEND_ROWS, _LEGEND_ROW_IN = 2, 0.15
"""Number of legend rows for which figures have space, and height of each further row in inches."""
_MARGIN = 1.4
"""Ratio of fitted limits to the outermost values."""
_NO_VALUES: Range = (0.1, 10.0)
"""Limits of a logarithmic axis without values."""
_LABEL_IN = {"x": 0.22, "y": 0.13}
"""Length along an axis that a tick label needs, in inches."""
_SINGLE: dict[str, Any] = {"marker": "o", "s": 3.5, "linewidths": 0, "alpha": 0.4}
_BAR: dict[str, Any] = {"alpha": 0.5, "linewidth": 0.9}
_MOST_NAMES, _MOST_NUMBERS = 36, 60
"""Largest number of rates in a row of panels with labels r1, r2, ..., and with labels 1, 2, ..."""


def panel_grid(
    panels: int,
    columns: int,
    height_in: float,
    style: FigureStyle,
    sharey: Sharing = "all",
    width_in: float | None = None,
    sharex: Sharing = "all",
) -> tuple[Figure, list[Axes]]:
    """Create a figure with panels of equal size.

    Parameters
    ----------
    panels
        Number of panels.
    columns
        Number of panels in a row.
    height_in
        Height of a panel, in inches.
    style
        Style of the figure.
    sharey, sharex
        Which panels share the limits of the vertical and the horizontal axis.
    width_in
        Width of the figure, in inches, if `style` sets none; by default, one or two columns of
        text.

    Returns
    -------
    figure
        The figure.
    panels
        Its panels, row by row.
    """
    from matplotlib.figure import Figure

    rows = math.ceil(panels / columns)
    width = style.width_in or width_in or figure_width(columns, style)
    figure = Figure(figsize=(width, rows * height_in + 0.45))
    grid = figure.subplots(rows, columns, sharex=sharex, sharey=sharey, squeeze=False)
    placed = list(grid.flat)
    for axes in placed[panels:]:
        axes.remove()
    for axes in placed[max(0, panels - columns) : panels]:
        axes.tick_params(labelbottom=True)
    return figure, placed[:panels]


def figure_width(columns: int, style: FigureStyle) -> float:
    """Return the width of a figure in inches: that of `style`, or one or two columns of text."""
    return style.width_in or (COLUMN_WIDTH_IN if columns == 1 else PAGE_WIDTH_IN)


def panels_abreast(panels: int) -> int:
    """Return how many panels to draw in a row of a figure with this number of panels."""
    return {1: 1, 2: 2, 3: 3, 4: 2, 5: 3, 6: 3}.get(panels, 4)


def fitted_limits(values: Floats, default: Range) -> Range:
    """Return limits slightly beyond the positive values, or `default` if no value is positive."""
    positive = values[np.isfinite(values) & (values > 0)]
    if len(positive) == 0:
        return default
    return float(positive.min()) / _MARGIN, float(positive.max()) * _MARGIN


def log_limits(values: Floats, column: str, style: FigureStyle) -> Range:
    """Return the limits of a logarithmic axis.

    Parameters
    ----------
    values
        Values on the axis, (n,); values that are not positive are ignored.
    column
        Column of the results that has the values.
    style
        Style of the figure. If it sets a range for `column`, the limits are this range, widened by
        whole decades to contain the values. Otherwise, they are slightly beyond the values.
    """
    positive = values[np.isfinite(values) & (values > 0)]
    if len(positive) == 0 or column not in style.axis_ranges:
        return fitted_limits(positive, style.axis_ranges.get(column, _NO_VALUES))
    low, high = float(positive.min()), float(positive.max())
    least, most = style.axis_ranges[column]
    return (
        least if least <= low else 10.0 ** math.floor(math.log10(low)),
        most if most >= high else 10.0 ** math.ceil(math.log10(high)),
    )


def draw_line(axes: Axes, x: Floats, y: Floats, plot_style: PlotStyle, faint: bool = False) -> None:
    """Draw the line of a codec.

    On a logarithmic axis, values of zero (lossless streams) become ticks at the lower edge.

    Parameters
    ----------
    axes
        The panel.
    x, y
        Points of the line, (n,).
    plot_style
        Colour, marker and line of the codec.
    faint
        Whether to draw a dotted line without markers.
    """
    style: dict[str, Any] = {"color": plot_style.colour, "clip_on": False, "zorder": 3}
    line: dict[str, Any] = {"linestyle": plot_style.line, "marker": plot_style.marker}
    zero = (y == 0) & (axes.get_yscale() == "log")
    axes.plot(
        x[~zero], y[~zero], markeredgewidth=0.6, **style, **(UNRANKED_LINE if faint else line)
    )
    draw_edge_ticks(axes, x[zero], plot_style)


def draw_edge_ticks(
    axes: Axes, x: Floats, plot_style: PlotStyle, edge: float = 0.0, alpha: float = 1.0
) -> None:
    """Draw ticks for lossless streams at an edge of a panel.

    Parameters
    ----------
    axes
        The panel.
    x
        Positions of the ticks, (n,).
    plot_style
        Style of the codec, which sets the colour.
    edge
        0 for the lower edge, 1 for the upper edge.
    alpha
        Opacity.
    """
    if len(x):
        end = abs(edge - _TICK_LENGTH)
        axes.vlines(
            x, edge, end, transform=axes.get_xaxis_transform(), color=plot_style.colour,
            alpha=alpha, linewidth=_TICK_WIDTH, clip_on=False, zorder=3,
        )  # fmt: skip


def draw_curve(axes: Axes, curve: Curve, plot_style: PlotStyle, faint: bool = False) -> None:
    """Draw medians as a line, with their spread: bars of quartiles or, with few scenes, dots of
    clouds.
    """
    draw_spread(axes, curve, plot_style)
    draw_line(axes, curve.x, curve.y, plot_style, faint)


def draw_spread(axes: Axes, curve: Curve, plot_style: PlotStyle) -> None:
    """Draw the quartiles of a curve as thin bars or, with few scenes, a dot for each cloud."""
    low = np.maximum(curve.low, axes.get_ylim()[0])
    has_bar = (curve.y > 0) & (curve.high > low)
    if has_bar.any():
        ends = curve.x[has_bar], low[has_bar], curve.high[has_bar]
        axes.vlines(*ends, color=plot_style.colour, zorder=2, **_BAR)
    x, y = curve.singles.T
    is_shown = np.isfinite(y) & ((y > 0) | (axes.get_yscale() != "log"))
    if is_shown.any():
        axes.scatter(x[is_shown], y[is_shown], color=plot_style.colour, zorder=2, **_SINGLE)


def spread_handles(curves: Iterable[Curve]) -> list[Artist]:
    """Return legend entries for quartiles and for single clouds, if a curve has them."""
    curves = list(curves)
    handles: list[Artist] = []
    if any(np.isfinite(curve.low).any() for curve in curves):
        bar: dict[str, Any] = {"linestyle": "", "marker": "|", "markersize": 7}
        handles.append(line_handle("quartiles over clouds", alpha=_BAR["alpha"], **bar))
    if any(len(curve.singles) for curve in curves):
        dot: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 1.9, "alpha": 0.6}
        handles.append(line_handle("single clouds", **dot))
    return handles


def line_handle(label: str, **line: Any) -> Line2D:
    """Return a legend entry with a line.

    Parameters
    ----------
    label
        Text of the entry.
    line
        Properties of matplotlib's ``Line2D``; the line is grey unless ``color`` is given.
    """
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **{"color": "#444444", **line})


def unranked_handle() -> Line2D:
    """Return a legend entry for lines of times that cannot be ranked."""
    return line_handle(f"not ranked: not timed alone {MIN_REPEATS} times", **UNRANKED_LINE)


def scan_handle() -> Line2D:
    """Return a legend entry for the line of a scan before coding."""
    return line_handle("the scan itself", **SCAN_LINE)


def lossless_tick_handle() -> Line2D:
    """Return a legend entry for ticks of lossless streams."""
    tick: dict[str, Any] = {"linestyle": "", "marker": "|", "markeredgewidth": _TICK_WIDTH}
    return line_handle("bits of lossless streams", **tick)


_LONG_NAME = 3


def label_rates(panels: Sequence[Axes], rates: Sequence[str], abreast: int) -> None:
    """Label the horizontal axes with the names of rates.

    Rates r1, r2, ... are labelled 1, 2, ... where space is short. Names of more than three letters
    stand upright.

    Parameters
    ----------
    panels
        The panels.
    rates
        Names of the rates, in the order of the axis.
    abreast
        Number of panels in a row, which determines the space.
    """
    density = len(rates) * abreast
    names = rates if density <= _MOST_NAMES else [rate.removeprefix("r") for rate in rates]
    step = math.ceil(density / _MOST_NUMBERS)
    rotation = 90 if max(map(len, names), default=0) > _LONG_NAME else 0
    for axes in panels:
        axes.set_xlim(-0.5, len(rates) - 0.5)
        axes.set_xticks(range(0, len(rates), step), names[::step], rotation=rotation)


def set_log(axes: Axes, axis: Literal["x", "y"], limits: Range, minor: bool = True) -> None:
    """Make an axis logarithmic.

    Powers of ten have labels and, where there is space, also 2 and 5 or 3 times these powers.

    Parameters
    ----------
    axes
        The panel.
    axis
        Which axis.
    limits
        Lower and upper limit.
    minor
        Whether to draw grid lines between the powers of ten.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

    line = axes.xaxis if axis == "x" else axes.yaxis
    getattr(axes, f"set_{axis}scale")("log")
    getattr(axes, f"set_{axis}lim")(*limits)
    subs = _labelled_digits(axes, axis, math.log10(limits[1] / limits[0]))
    line.set_major_locator(LogLocator(subs=subs, numticks=12))
    line.set_major_formatter(FuncFormatter(_log_label))
    inside = LogLocator(subs=list(range(2, 10)), numticks=12) if minor else NullLocator()
    line.set_minor_locator(inside)
    line.set_minor_formatter(NullFormatter())
    axes.grid(which="minor", axis=axis, linewidth=0.25, color="#ececec")


def _labelled_digits(axes: Axes, axis: Literal["x", "y"], decades: float) -> tuple[int, ...]:
    extent, figure = axes.get_window_extent(), axes.get_figure(root=True)
    pixels = extent.width if axis == "x" else extent.height
    labels = pixels / (figure.dpi if figure else 1) / _LABEL_IN[axis]
    if decades < 0.7:
        return tuple(range(1, 10))
    if 2 * decades > labels:
        return (1,)
    return (1, 2, 5) if 3 * decades <= labels else (1, 3)


def _log_label(value: float, _: int) -> str:
    if 1e-3 <= value < 1e5:
        return f"{value:g}"
    return f"$\\mathdefault{{10^{{{round(math.log10(value))}}}}}$"


def wrapped(text: str, width_in: float, style: FigureStyle) -> str:
    """Return a text with line breaks, so that it is about `width_in` inches wide in a figure."""
    character_in = 0.56 * style.font_size / 72
    return textwrap.fill(text, max(6, int(width_in / character_in)), break_long_words=False)


def titled(title: str, rows: pd.DataFrame) -> str:
    """Return a title followed by the number of clouds in `rows` and, if smaller, of scenes."""
    clouds, scenes = (with_scenes(rows)[name].nunique() for name in ("cloud", SCENE))
    text = f"{title} (n\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}{clouds}"
    return f"{text})" if scenes == clouds else f"{text} of {scenes} scene{'s' * (scenes > 1)})"


def set_title(axes: Axes, text: str, columns: int, style: FigureStyle) -> None:
    """Set a panel's title, wrapped to the width of a panel; `columns` panels are in a row."""
    figure: Any = axes.figure
    width_in = (float(figure.get_size_inches()[0]) - 0.5) / columns
    axes.set_title(wrapped(text, width_in, style), pad=3)


def label_outer(panels: Sequence[Axes], columns: int, x: str, y: str) -> None:
    """Label the vertical axes of the first column, and the horizontal axes of the last row.

    Parameters
    ----------
    panels
        Panels of a figure, row by row.
    columns
        Number of panels in a row.
    x, y
        Labels of the axes.
    """
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
    """Add a legend above the panels, with an entry for each codec and the extra entries."""
    add_fitting_legend(figure, [*codec_handles(codecs, style), *extra_handles], style)


def add_fitting_legend(figure: Figure, handles: Sequence[Artist], style: FigureStyle) -> None:
    """Add a legend above the panels, with as many entries in a row as the figure's width allows."""
    widest_in = max(len(str(h.get_label())) for h in handles) * 0.58 * style.font_size / 72 + 0.5
    add_rows_legend(figure, handles, int(figure.get_size_inches()[0] / widest_in))


def codec_handles(codecs: Sequence[str], style: FigureStyle) -> list[Line2D]:
    """Return a legend entry for each codec."""
    looks = map(style.of_codec, codecs)
    return [line_handle(k.title, color=k.colour, marker=k.marker, ls=k.line) for k in looks]


def add_rows_legend(
    figure: Figure, handles: Sequence[Artist], most_abreast: int, **options: Any
) -> None:
    """Add a legend above the panels, with at most `most_abreast` entries in a row."""
    rows = math.ceil(len(handles) / max(1, most_abreast))
    if rows > _LEGEND_ROWS:  # the panels keep their size
        height_in = float(figure.get_size_inches()[1])
        figure.set_figheight(height_in + (rows - _LEGEND_ROWS) * _LEGEND_ROW_IN)
    abreast = math.ceil(len(handles) / rows)
    by_column = [handle for column in range(abreast) for handle in handles[column::abreast]]
    figure.legend(handles=by_column, loc="outside upper center", ncols=abreast, **options)

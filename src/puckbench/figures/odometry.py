from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.figures.checks import require_numbers, require_rows
from puckbench.figures.panels import (
    add_legend,
    fitted_limits,
    label_outer,
    line_handle,
    panel_grid,
    panels_abreast,
    set_log,
    set_title,
    titled,
)
from puckbench.figures.plotted_metrics import BETTER
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle
from puckbench.metrics.table_registry import ODOMETRY, UNDECODED
from puckbench.metrics.tables.odometry_bits import (
    ABSOLUTE,
    DRIFT,
    Reference,
    mean_curve,
    reference_of,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PANEL_IN = 1.8
_LINES: dict[bool, Any] = {True: "-", False: (0, (3, 2))}
"""Line styles of undecoded drives with and without times of firings."""
_COLUMNS = ("dataset", "cloud", "codec", "rate", "has_times", "lost_turns", ABSOLUTE)
_MEASURES = {DRIFT: ("Drift (%)", (0.1, 100.0)), ABSOLUTE: ("Absolute error (m)", (0.01, 10.0))}
"""Labels and default limits of the error, by column; the first column with values is shown."""


@FIGURES.register(
    "odometry", title="Drift of odometry against bits", category="Drives", needs=(ODOMETRY,)
)
def draw_odometry(drives: pd.DataFrame, style: FigureStyle) -> Figure:
    """Drift of KISS-ICP on decoded turns, mean over lengths of 10, 20 and 50 m and over drives; if
    all are shorter than 10 m, the absolute error of positions.
    Grey: undecoded drives with times of firings (solid) and without (dashed), and 95 % intervals of
    the means (Student's t).

    Large markers: the lowest rate from which on a codec's drift is at most the interval's upper end
    or 1.2 times the mean. Hollow markers: turns were lost (estimated motion is wrong by more than
    0.5 m or 5 degrees). Beside longer drives, those shorter than 10 m are not shown. n: drives.
    """
    require_rows(drives, _COLUMNS, "drives")
    measures = [name for name in _MEASURES if name in drives]
    require_numbers(drives, tuple(measures), "drives")
    complete = {name: _complete(drives, name) for name in measures}
    measure = next((name for name, rows in complete.items() if len(rows)), "")
    if not measure:
        raise InputError("drives table: no data set of which all drives have an error")
    rows, (label, limits_y) = complete[measure], _MEASURES[measure]
    names = style.ordered_datasets(rows["dataset"])
    abreast = panels_abreast(len(names))
    figure, panels = panel_grid(len(names), abreast, _PANEL_IN, style)
    codecs = rows[rows["codec"] != UNDECODED]
    limits = fitted_limits(codecs["bpp"].to_numpy(float), (0.1, 30.0))
    errors = fitted_limits(rows[measure].to_numpy(float), limits_y)
    for axes, name in zip(panels, names, strict=True):
        set_log(axes, "x", limits, minor=False)
        set_log(axes, "y", errors, minor=False)
        dataset_rows = rows[rows["dataset"] == name]
        _draw_panel(axes, dataset_rows, measure, style)
        set_title(axes, titled(style.title(name), dataset_rows), abreast, style)
    label_outer(panels, abreast, f"Bits per return, {BETTER}", f"{label}, {BETTER}")
    labels = {True: "undecoded", False: "undecoded, without times"}
    handles = [line_handle(labels[k], linewidth=0.9, linestyle=_LINES[k]) for k in labels]
    add_legend(figure, style.ordered_codecs(codecs["codec"]), style, handles)
    return figure


def _complete(drives: pd.DataFrame, measure: str) -> pd.DataFrame:
    """Return the rows of the data sets whose drives all have values."""
    values = drives.groupby("dataset")[measure]
    return drives[values.transform(lambda column: column.notna().all())]


def _draw_panel(axes: Axes, rows: pd.DataFrame, measure: str, style: FigureStyle) -> None:
    references: dict[bool, Reference] = {}
    for has_times in sorted(rows[rows["codec"] == UNDECODED]["has_times"].unique()):
        reference = references[bool(has_times)] = reference_of(rows, measure, bool(has_times))
        axes.axhspan(reference.low, reference.high, color="#dddddd", linewidth=0, zorder=1)
        line = _LINES[bool(has_times)]
        axes.axhline(reference.mean, color="#444444", linewidth=0.9, linestyle=line, zorder=2)
    for codec in style.ordered_codecs(rows["codec"]):
        if codec == UNDECODED:
            continue
        curve = mean_curve(rows[rows["codec"] == codec], measure)
        reference = references[bool(curve["has_times"].all())]
        bits, errors = curve["bpp"].to_numpy(float), curve[measure].to_numpy(float)
        look = style.of_codec(codec)
        common: dict[str, Any] = {"color": look.colour, "zorder": 3}
        axes.plot(bits, errors, linestyle=look.line, **common)
        common |= {"marker": look.marker, "linestyle": ""}
        lost = curve["lost_turns"].to_numpy() > 0
        axes.plot(bits[~lost], errors[~lost], **common)
        axes.plot(bits[lost], errors[lost], markerfacecolor="white", **common)
        good = np.logical_and.accumulate((errors <= reference.most)[::-1])[::-1]
        if good.any():
            first = int(np.argmax(good))
            axes.plot(bits[first], errors[first], markersize=2.2 * style.marker_size, **common)

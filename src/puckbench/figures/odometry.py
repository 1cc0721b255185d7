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
from puckbench.metrics.tables.odometry_bits import DRIFT, Reference, mean_curve, reference_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PANEL_IN = 1.8
_LINES: dict[bool, Any] = {True: "-", False: (0, (3, 2))}
"""Line styles of undecoded drives with and without times of firings."""
_COLUMNS = ("dataset", "cloud", "codec", "rate", "has_times", "lost_turns", DRIFT)


@FIGURES.register(
    "odometry", title="Drift of odometry against bits", category="Drives", needs=(ODOMETRY,)
)
def draw_odometry(drives: pd.DataFrame, style: FigureStyle) -> Figure:
    """Drift of KISS-ICP on decoded turns, mean over lengths of 10, 20 and 50 m and over drives.
    Grey: undecoded drives with times of firings (solid) and without (dashed), and 95 % intervals of
    the means (Student's t).

    Large markers: the lowest rate from which on a codec's drift is at most the interval's upper end
    or 1.2 times the mean. Hollow markers: turns were lost (estimated motion is wrong by more than
    0.5 m or 5 degrees). Drives shorter than 10 m are not shown. n: drives.
    """
    require_rows(drives, _COLUMNS, "drives")
    require_numbers(drives, (DRIFT,), "drives")
    long = drives.groupby("dataset")[DRIFT].transform(lambda values: values.notna().all())
    rows = drives[long]
    names = style.ordered_datasets(rows["dataset"])
    if not names:
        raise InputError("drives table: no drive of 10 m")
    abreast = panels_abreast(len(names))
    figure, panels = panel_grid(len(names), abreast, _PANEL_IN, style)
    codecs = rows[rows["codec"] != UNDECODED]
    limits = fitted_limits(codecs["bpp"].to_numpy(float), (0.1, 30.0))
    drifts = fitted_limits(rows[DRIFT].to_numpy(float), (0.1, 100.0))
    for axes, name in zip(panels, names, strict=True):
        set_log(axes, "x", limits, minor=False)
        set_log(axes, "y", drifts, minor=False)
        dataset_rows = rows[rows["dataset"] == name]
        _draw_panel(axes, dataset_rows, style)
        set_title(axes, titled(style.title(name), dataset_rows), abreast, style)
    label_outer(panels, abreast, f"Bits per return, {BETTER}", f"Drift (%), {BETTER}")
    labels = {True: "undecoded", False: "undecoded, without times"}
    handles = [line_handle(labels[k], linewidth=0.9, linestyle=_LINES[k]) for k in labels]
    add_legend(figure, style.ordered_codecs(codecs["codec"]), style, handles)
    return figure


def _draw_panel(axes: Axes, rows: pd.DataFrame, style: FigureStyle) -> None:
    references: dict[bool, Reference] = {}
    for has_times in sorted(rows[rows["codec"] == UNDECODED]["has_times"].unique()):
        reference = references[bool(has_times)] = reference_of(rows, DRIFT, bool(has_times))
        axes.axhspan(reference.low, reference.high, color="#dddddd", linewidth=0, zorder=1)
        line = _LINES[bool(has_times)]
        axes.axhline(reference.mean, color="#444444", linewidth=0.9, linestyle=line, zorder=2)
    for codec in style.ordered_codecs(rows["codec"]):
        if codec == UNDECODED:
            continue
        curve = mean_curve(rows[rows["codec"] == codec], DRIFT)
        reference = references[bool(curve["has_times"].all())]
        bits, drift = curve["bpp"].to_numpy(float), curve[DRIFT].to_numpy(float)
        look = style.of_codec(codec)
        common: dict[str, Any] = {"color": look.colour, "zorder": 3}
        axes.plot(bits, drift, linestyle=look.line, **common)
        common |= {"marker": look.marker, "linestyle": ""}
        lost = curve["lost_turns"].to_numpy() > 0
        axes.plot(bits[~lost], drift[~lost], **common)
        axes.plot(bits[lost], drift[lost], markerfacecolor="white", **common)
        good = np.logical_and.accumulate((drift <= reference.most)[::-1])[::-1]
        if good.any():
            first = int(np.argmax(good))
            axes.plot(bits[first], drift[first], markersize=2.2 * style.marker_size, **common)

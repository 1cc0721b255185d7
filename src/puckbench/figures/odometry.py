from __future__ import annotations

from typing import TYPE_CHECKING, Any

from puckbench.figures.axis_labels import BETTER
from puckbench.figures.checks import require_rows
from puckbench.figures.margins import (
    draw_intervals,
    draw_margin,
    handles_of_margin,
    set_losses,
)
from puckbench.figures.panels import (
    add_fitting_legend,
    fitted_limits,
    line_handle,
    set_log,
    set_title,
)
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import COLUMN_WIDTH_IN, PAGE_WIDTH_IN, FigureStyle
from puckbench.recordings.drives import AZIMUTH, KEPT, NONE
from puckbench.tables.odometry_differences import ALL, MEASURES, ODOMETRIES
from puckbench.tables.registry import ODOMETRY, UNDECODED

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CODE = ("puckbench.tables.odometry_differences",)

_PANEL_IN, _AROUND_IN = 1.75, 0.75
_COLUMNS = ("dataset", "odometry", "codec", "times", "bits", "difference", "margin")
_TIMES = {KEPT: "own times", AZIMUTH: "times from azimuths", NONE: "no times"}
_OFFSET = {KEPT: 1.0, AZIMUTH: 0.985, NONE: 1.015}
"""Factors of bits that keep bars of one rate apart."""
_NO_TIMES_LINE = (0, (4, 2))
_LOST: dict[str, Any] = {"marker": "x", "color": "black", "markersize": 3.0, "linestyle": ""}


@FIGURES.register("odometry", title="Odometry after decoding", category="Drives", needs=(ODOMETRY,))
def draw_odometry(odometry_differences: pd.DataFrame, style: FigureStyle) -> Figure:
    """Error that coding adds to odometry, against bits per return, for each method of odometry and
    data set. It is the drift after decoding minus the drift without coding. For drives that are
    too short for a drift, it is the difference of absolute position errors. The axis is linear
    below the margin, and logarithmic above.

    Markers are means over n drives. Bars are 95 % intervals (Student's t) for six or more drives;
    with fewer, there is a dot for each drive. Odometry is as good as without coding if the whole
    bar is below the margin (grey). Dashed lines are undecoded drives whose points have no times.
    Crosses mark drives with lost turns, i.e. revolutions of the sensor.
    """
    from matplotlib.figure import Figure

    require_rows(odometry_differences, _COLUMNS, "odometry_differences")
    rows = odometry_differences[odometry_differences["dataset"] != ALL]
    names = style.ordered_datasets(rows["dataset"])
    odometries = [name for name in ODOMETRIES if name in set(rows["odometry"])]
    width = style.width_in or (PAGE_WIDTH_IN if len(names) > 1 else COLUMN_WIDTH_IN)
    figure = Figure(figsize=(width, _PANEL_IN * len(odometries) + _AROUND_IN))
    grid = figure.subplots(len(odometries), len(names), sharex="all", squeeze=False)
    bits = rows["bits"].to_numpy(float)
    for line, odometry in zip(grid, odometries, strict=True):
        before = ""
        for axes, name in zip(line, names, strict=True):
            panel = rows[(rows["dataset"] == name) & (rows["odometry"] == odometry)]
            set_log(axes, "x", fitted_limits(bits, (0.1, 30.0)), minor=False)
            if panel.empty:
                axes.set_axis_off()
                continue
            measure = str(panel["measure"].iloc[0])
            set_losses(axes, rows[rows["measure"] == measure], ["low", "high", "difference"])
            _draw_panel(axes, panel, style)
            title = f"{style.title(name)} (n = {panel['trajectories'].iloc[0]}), {odometry}"
            set_title(axes, title, len(names), style)
            if measure != before:
                added = "Drift added" if measure == MEASURES[0].name else "Error added"
                axes.set_ylabel(f"{added} ({panel['unit'].iloc[0]}), {BETTER}")
            before = measure
    figure.supxlabel(f"Bits per return, {BETTER}", fontsize=style.font_size)
    add_fitting_legend(figure, _handles(rows, style), style)
    return figure


def _draw_panel(axes: Axes, rows: pd.DataFrame, style: FigureStyle) -> None:
    draw_margin(axes, rows["margin"].iloc[0])
    untimed = rows[(rows["codec"] == UNDECODED) & (rows["times"] == NONE)]
    for value in untimed["difference"]:
        axes.axhline(value, color="#444444", linewidth=0.9, linestyle=_NO_TIMES_LINE, zorder=2)
    coded = rows[rows["codec"] != UNDECODED]
    for codec in style.ordered_codecs(coded["codec"]):
        look = style.of_codec(codec)
        ordered = coded[coded["codec"] == codec].sort_values("bits")
        for times, curve in ordered.groupby("times"):
            bits = curve["bits"].to_numpy(float) * _OFFSET[str(times)]
            middle = curve["difference"].to_numpy(float)
            common: dict[str, Any] = {"color": look.colour, "zorder": 3}
            samples = curve["trajectories"].iloc[0]
            draw_intervals(axes, bits, curve, samples, linewidth=1.0, **common)
            axes.plot(bits, middle, linestyle=(0, (1, 3)), linewidth=0.7, **common)
            axes.plot(bits, middle, **_marker(look, str(times)), zorder=4)
            lost = curve["lost_turns"].to_numpy(float) > 0
            axes.plot(bits[lost], middle[lost], zorder=5, **_LOST)


def _marker(look: Any, times: str) -> dict[str, Any]:
    face = "white" if times == NONE else look.colour
    return {
        "marker": look.marker,
        "color": look.colour,
        "markerfacecolor": face,
        "markersize": 4.2,
        "linestyle": "",
    }


def _handles(rows: pd.DataFrame, style: FigureStyle) -> list[Artist]:
    coded = rows[rows["codec"] != UNDECODED]
    handles: list[Artist] = []
    for codec in style.ordered_codecs(coded["codec"]):
        present = set(coded[coded["codec"] == codec]["times"])
        look = style.of_codec(codec)
        handles += [
            line_handle(f"{look.title}, {words}", **_marker(look, times))
            for times, words in _TIMES.items()
            if times in present
        ]
    untimed = {"linewidth": 0.9, "linestyle": _NO_TIMES_LINE}
    if ((rows["codec"] == UNDECODED) & (rows["times"] == NONE)).any():
        handles.append(line_handle("undecoded, no times", **untimed))
    handles += handles_of_margin(rows)
    if (coded["lost_turns"] > 0).any():
        handles.append(line_handle("turns lost", **_LOST))
    return handles

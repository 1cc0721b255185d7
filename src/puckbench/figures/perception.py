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
from puckbench.tables.registry import PERCEPTION

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CODE = ("puckbench.tables.perception_losses",)

_PANEL_IN, _AROUND_IN = 1.6, 0.8
_COLUMNS = ("dataset", "task", "codec", "bits", "loss", "margin", "along_rays")
_LINES = {True: "-", False: (0, (1, 1.5))}
"""Lines of codecs of returns (True) and of points."""
_WORDS = {True: "returns", False: "points"}


@FIGURES.register("perception", title="Tasks after decoding", category="Tasks", needs=(PERCEPTION,))
def draw_perception(perception_losses: pd.DataFrame, style: FigureStyle) -> Figure:
    """Loss of each task by coding, against bits per point or return: a row of panels for each task,
    a column for each data set. Positive losses are worse results than without coding. The axis is
    linear below the margin, and logarithmic above.

    Solid lines and filled markers are codecs of returns, which move points along the sensor's rays;
    dotted lines and open markers are codecs of points. Markers are means over n scenes. Bars are
    95 % intervals (Student's t) for six or more scenes; with fewer, dots are the least and the
    greatest loss of a scene. A task is as good as without coding if the whole bar is below the
    margin (grey).
    """
    from matplotlib.figure import Figure

    require_rows(perception_losses, _COLUMNS, "perception_losses")
    rows = perception_losses
    names, tasks = style.ordered_datasets(rows["dataset"]), list(dict.fromkeys(rows["task"]))
    width = style.width_in or (PAGE_WIDTH_IN if len(names) > 1 else COLUMN_WIDTH_IN)
    figure = Figure(figsize=(width, _PANEL_IN * len(tasks) + _AROUND_IN))
    grid = figure.subplots(len(tasks), len(names), sharex="all", sharey="row", squeeze=False)
    limits = fitted_limits(rows["bits"].to_numpy(float), (0.1, 30.0))
    lowest: dict[str, Axes] = {}
    for line, task in zip(grid, tasks, strict=True):
        of_task = rows[rows["task"] == task]
        set_losses(line[0], of_task, ["low", "high", "least", "most", "loss"])
        first = True
        for axes, name in zip(line, names, strict=True):
            panel = of_task[of_task["dataset"] == name]
            set_log(axes, "x", limits, minor=False)
            if panel.empty:
                axes.set_axis_off()
                continue
            lowest[name] = axes
            _draw_panel(axes, panel, style)
            title = f"{style.title(name)} (n = {panel['scenes'].max()})"
            set_title(axes, title, len(names), style)
            if first:
                axes.set_ylabel(_loss_label(panel["task_title"].iloc[0], panel["unit"].iloc[0]))
                axes.tick_params(labelleft=True)
                first = False
    for axes in lowest.values():  # there may be no panel below
        axes.tick_params(labelbottom=True)
    figure.supxlabel(f"Bits per point or return, {BETTER}", fontsize=style.font_size)
    add_fitting_legend(figure, _handles(rows, style), style)
    return figure


def _loss_label(task: str, unit: str) -> str:
    """Return the label of a y axis: a task in short lines, and the unit of its losses.

    The loss of a result in percent is in percentage points.
    """
    lines = task.replace(", ", ",\n")
    return f"{lines}:\nloss ({'points' if unit == '%' else unit})"


def _draw_panel(axes: Axes, rows: pd.DataFrame, style: FigureStyle) -> None:
    draw_margin(axes, rows["margin"].iloc[0])
    for codec in style.ordered_codecs(rows["codec"]):
        curve = rows[rows["codec"] == codec].sort_values("bits")
        colour = style.of_codec(codec).colour
        bits, loss = curve["bits"].to_numpy(float), curve["loss"].to_numpy(float)
        samples = curve["scenes"].max()
        draw_intervals(axes, bits, curve, samples, color=colour, linewidth=0.9, zorder=3)
        axes.plot(bits, loss, zorder=4, **_line(codec, bool(curve["along_rays"].iloc[0]), style))


def _line(codec: str, along_rays: bool, style: FigureStyle) -> dict[str, Any]:
    look = style.of_codec(codec)
    return {
        "color": look.colour,
        "marker": look.marker,
        "markersize": 3.6,
        "markerfacecolor": look.colour if along_rays else "white",
        "linewidth": 0.9,
        "linestyle": _LINES[along_rays],
    }


def _handles(rows: pd.DataFrame, style: FigureStyle) -> list[Artist]:
    handles: list[Artist] = []
    for codec in style.ordered_codecs(rows["codec"]):
        along_rays = bool(rows[rows["codec"] == codec]["along_rays"].iloc[0])
        label = f"{style.of_codec(codec).title} ({_WORDS[along_rays]})"
        handles.append(line_handle(label, **_line(codec, along_rays, style)))
    return [*handles, *handles_of_margin(rows)]

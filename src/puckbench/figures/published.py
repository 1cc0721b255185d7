"""The figure of `puckbench compare --published`: a run's curves beside published ones."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.geometry.cloud import Floats
from puckbench.figures.axis_labels import BPP, axis_label
from puckbench.figures.panels import add_fitting_legend, figure_width, line_handle, set_title
from puckbench.figures.plot_styles import PlotStyle, codec_style
from puckbench.figures.style import FigureStyle
from puckbench.published_sources.beside import HERE, curves_of, marks_of
from puckbench.published_sources.rows import COUNTERPARTS
from puckbench.results.columns import column_named

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PANEL_IN = 2.4
_ABREAST = 2


def draw_published(points: pd.DataFrame, style: FigureStyle) -> Figure:
    """Draw a run's curves beside published ones, with a panel for each data set and metric.

    Curves of the run are thick. Published curves under the same conditions are thin; those under
    other conditions are dashed, with hollow markers, and the legend has the mark of their
    differences (`puckbench.published_sources.beside.marks_of`). Lossless points are not drawn, and
    no line joins points between which bits are not known.

    Parameters
    ----------
    points
        Table of `puckbench.published_sources.beside.beside_published`.
    style
        Style of the figure.
    """
    from matplotlib.figure import Figure

    keys = list(dict.fromkeys(zip(points["dataset"], points["metric"], strict=True)))
    columns = min(_ABREAST, len(keys))
    rows = ceil(len(keys) / columns)
    figure = Figure(figsize=(figure_width(columns, style), rows * _PANEL_IN + 0.6))
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axes in panels[len(keys) :]:
        axes.remove()
    by_key = dict(zip(keys, panels, strict=False))
    marks = marks_of(points)
    handles: dict[str, Artist] = {}
    for curve, part in curves_of(points):
        label, line = _look(curve, marks, style)
        handles.setdefault(label, line_handle(label, **line))
        by_key[curve["dataset"], curve["metric"]].plot(*_places(part), **line)
    for (dataset, metric), axes in by_key.items():
        _set_axes(axes, metric)
        set_title(axes, style.title(dataset), columns, style)
    add_fitting_legend(figure, list(handles.values()), style)
    return figure


def _places(rows: pd.DataFrame) -> tuple[Floats, Floats]:
    """Return bits and values of a curve; nan breaks the line where bits are not known."""
    if rows["bpp"].notna().all():
        rows = rows[np.isfinite(rows["measured"])].sort_values("bpp")
    return rows["bpp"].to_numpy(float), rows["measured"].to_numpy(float)


def _set_axes(axes: Axes, metric: str) -> None:
    shown = column_named(metric)
    axes.set_xscale("log")
    if shown.unit != "dB":
        axes.set_yscale("log")
    axes.set_xlabel(axis_label(BPP))
    axes.set_ylabel(axis_label(shown))


def _look(
    curve: Mapping[str, Any], marks: Mapping[str, str], style: FigureStyle
) -> tuple[str, dict[str, Any]]:
    """Return the legend of a curve, and the properties of its line."""
    if curve["origin"] == HERE:
        look = style.of_codec(curve["codec"])
        return look.title, _line(look, style, 1.6, "-", look.colour)
    look = codec_style(COUNTERPARTS.get(curve["codec"], curve["codec"]))
    mark = marks.get(curve["differs"], "")
    label = f"{curve['codec']}, {curve['origin']} {mark}".strip()
    return label, _line(look, style, 0.8, "--" if mark else "-", "none" if mark else look.colour)


def _line(
    look: PlotStyle, style: FigureStyle, width: float, line: str, face: str
) -> dict[str, Any]:
    return {
        "color": look.colour,
        "marker": look.marker,
        "linestyle": line,
        "linewidth": style.line_width * width,
        "markersize": style.marker_size,
        "markerfacecolor": face,
    }

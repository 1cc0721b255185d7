from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jenco2022.figures.model_styles import model_style, ordered_models, source_title
from jenco2022.figures.residual_table import compared, subsample
from pointkit.errors import InputError
from puckbench.figures.checks import require_rows
from puckbench.figures.panels import wrapped
from puckbench.figures.registry import FIGURES, at
from puckbench.figures.style import COLUMN_WIDTH_IN, PAGE_WIDTH_IN, FigureStyle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")

_figure = partial(FIGURES.register, category="Sensor")
_figure_at_5_m = partial(_figure, needs=(at(5),))
SAMPLE = 60_000
"""Largest number of points that are drawn of a scan; more points would hide each other."""

_COLUMNS = ("model", "surface", "distance_m", "laser_id", "elevation_deg", "x_m", "y_m", "z_m")
_LABELS = {
    "x_m": "Along the wall, x (m)",
    "y_m": "Distance from the wall, y (m)",
    "z_m": "Height, z (m)",
}
_MODELS = ("none", "hdl64e", "vlp16", "vlp16_divergence", "vlp16_incidence")
_FAR_M, _NEAR_M = 5.0, 1.0
_ROOM_VIEW = (40, 110)


@_figure_at_5_m("fig_5_2", title="Full scan at 5 m, by laser", number="5.2")
def draw_full_scan(scans: pd.DataFrame, style: FigureStyle) -> Figure:
    """All returns of one sweep 5 m from the wall, seen from behind the sensor (thesis figure 5.2).

    The colour shows the elevation of the laser. At most 60,000 random points are drawn, denser on
    wall and floor. The virtual room is 5 m wide and 2.6 m high.
    """
    return _draw_space(_shown(scans, _FAR_M), _ROOM_VIEW, style)


@_figure("fig_5_3", title="Full scan at 1 m, by laser", number="5.3", needs=(at(1),))
def draw_full_near_scan(scans: pd.DataFrame, style: FigureStyle) -> Figure:
    """All returns of one sweep 1 m from the wall, as in figure 5.2 (thesis figure 5.3)."""
    return _draw_space(_shown(scans, _NEAR_M), _ROOM_VIEW, style)


@_figure_at_5_m("fig_5_4", title="Wall at 5 m, by laser", number="5.4")
def draw_wall(scans: pd.DataFrame, style: FigureStyle) -> Figure:
    """The wall at 5 m, seen from the front (thesis figure 5.4).

    Points are drawn as in figure 5.2.
    """
    return _draw_plane(_shown(scans, _FAR_M, "wall"), "x_m", "z_m", True, style)


@_figure_at_5_m("fig_5_5", title="Floor at 5 m, by laser", number="5.5")
def draw_floor(scans: pd.DataFrame, style: FigureStyle) -> Figure:
    """The floor in front of the wall at 5 m, from above; the sensor is on the right (thesis figure
    5.5). Points are drawn as in figure 5.2.
    """
    return _draw_plane(_shown(scans, _FAR_M, "floor"), "y_m", "x_m", True, style)


@_figure_at_5_m("fig_5_6", title="Wall at 5 m from the side", number="5.6")
def draw_wall_side(scans: pd.DataFrame, style: FigureStyle) -> Figure:
    """The wall at 5 m from the side; depths are stretched (thesis figure 5.6).

    Each laser's points are offset by the laser's bias. Points are drawn as in figure 5.2.
    """
    return _draw_plane(_shown(scans, _FAR_M, "wall"), "y_m", "z_m", False, style)


@_figure_at_5_m("fig_5_7", title="One laser on the wall", number="5.7")
def draw_wall_laser(scans: pd.DataFrame, style: FigureStyle) -> Figure:
    """Returns of the middle laser from the wall at 5 m; depth is stretched (thesis figure 5.7)."""
    return _draw_space(_shown(scans, _FAR_M, "wall"), (20, -50), style, one_laser=True)


@_figure_at_5_m("fig_5_8", title="Floor at 5 m from the side", number="5.8")
def draw_floor_side(scans: pd.DataFrame, style: FigureStyle) -> Figure:
    """The floor in front of the wall at 5 m from the side; heights are stretched, and the sensor is
    on the right (thesis figure 5.8). Points are drawn as in figure 5.2.
    """
    return _draw_plane(_shown(scans, _FAR_M, "floor"), "y_m", "z_m", False, style)


@_figure_at_5_m("fig_5_9", title="One laser on the floor", number="5.9")
def draw_floor_laser(scans: pd.DataFrame, style: FigureStyle) -> Figure:
    """Returns of the middle laser from the floor in front of the wall at 5 m; heights are stretched
    (thesis figure 5.9).
    """
    return _draw_space(_shown(scans, _FAR_M, "floor"), (20, -50), style, one_laser=True)


@_figure_at_5_m("fig_5_16", title="Error models on the wall at 5 m", number="5.16")
def draw_wall_models(scans: pd.DataFrame, style: FigureStyle) -> Figure:
    """The wall at 5 m by error model, from the side; depths are stretched equally in all panels
    (thesis figure 5.16). Points are drawn as in figure 5.2.
    """
    return _draw_models(_part(scans, _FAR_M, "wall"), style)


@_figure_at_5_m("fig_5_17", title="Error models on the floor at 5 m", number="5.17")
def draw_floor_models(scans: pd.DataFrame, style: FigureStyle) -> Figure:
    """The floor in front of the wall at 5 m by error model, from the side; heights are stretched
    equally in all panels (thesis figure 5.17). Points are drawn as in figure 5.2.
    """
    return _draw_models(_part(scans, _FAR_M, "floor"), style)


def _part(scans: pd.DataFrame, distance_m: float, surface: str | None) -> pd.DataFrame:
    require_rows(scans, _COLUMNS, "scan")
    rows: NDArray[np.bool_] = np.abs(scans["distance_m"].to_numpy(dtype=float) - distance_m) < 0.05
    if surface is not None:
        rows &= (scans["surface"] == surface).to_numpy()
    if not rows.any():
        raise InputError(f"scan table: no {surface or 'surface'} at {distance_m:g} m")
    return scans[rows]


def _shown(scans: pd.DataFrame, distance_m: float, surface: str | None = None) -> pd.DataFrame:
    part = _part(scans, distance_m, surface)
    model = compared(part)[0]
    return subsample(part[part["model"] == model], SAMPLE, model)


def _middle_laser(scan: pd.DataFrame) -> pd.DataFrame:
    elevations = scan["elevation_deg"].to_numpy(dtype=float)
    lasers = np.unique(elevations)
    rows: NDArray[np.bool_] = elevations == lasers[len(lasers) // 2]
    return scan[rows]


def _draw_plane(
    scan: pd.DataFrame, across: str, upward: str, equal: bool, style: FigureStyle
) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(style.width_in or COLUMN_WIDTH_IN, 2.5))
    axes = figure.subplots()
    colours = _laser_colours(scan)
    _scatter(axes, scan, across, upward, colours)
    if equal:
        axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(_LABELS[across])
    axes.set_ylabel(_LABELS[upward])
    axes.set_title(source_title(scan["model"].iloc[0], style), pad=3)
    _add_laser_bar(figure, axes, colours)
    return figure


def _draw_space(
    scan: pd.DataFrame, view_deg: tuple[float, float], style: FigureStyle, one_laser: bool = False
) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(style.width_in or COLUMN_WIDTH_IN, 2.9))
    axes: Any = figure.add_subplot(projection="3d")
    colours = _laser_colours(scan)
    if one_laser:
        scan = _middle_laser(scan)
    points = scan[["x_m", "y_m", "z_m"]].to_numpy().T
    rgba = colours.to_rgba(scan["elevation_deg"].to_numpy())
    size = 1.5 if one_laser else 0.6
    axes.scatter(*points, s=size, color=rgba, linewidths=0, depthshade=False, rasterized=True)
    axes.view_init(*view_deg)
    # Constrained layout ignores labels of 3D axes: zoom keeps them on the page.
    sizes = (1.0, 1.0, 0.8) if one_laser else tuple(np.ptp(points, axis=1).clip(1e-3))
    axes.set_box_aspect(sizes, zoom=0.8 if one_laser else 0.85)
    for axis, size in zip((axes.xaxis, axes.yaxis, axes.zaxis), sizes, strict=True):
        share = size / max(sizes)
        axis.set_major_locator(_few_ticks(4 if share > 0.5 else 2 if share > 0.25 else 1))
    axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
    axes.set_title(source_title(scan["model"].iloc[0], style), pad=0)
    _add_laser_bar(figure, axes, colours, pad=0.14)
    return figure


def _draw_models(part: pd.DataFrame, style: FigureStyle) -> Figure:
    from matplotlib.figure import Figure

    models = ordered_models(part["model"])
    models = [model for model in models if model in _MODELS] or models
    on_wall = part["surface"].iloc[0] == "wall"
    size = style.width_in or PAGE_WIDTH_IN, 2.4 if on_wall else 1.0 * len(models) + 0.4
    figure = Figure(figsize=size)
    shape = (1, len(models)) if on_wall else (len(models), 1)
    panels = figure.subplots(*shape, sharex=True, sharey=True, squeeze=False).ravel()
    colours = _laser_colours(part)
    abreast = len(models) if on_wall else 1
    for axes, model in zip(panels, models, strict=True):
        scan = subsample(part[part["model"] == model], SAMPLE, model)
        _scatter(axes, scan, "y_m", "z_m", colours)
        axes.xaxis.set_major_locator(_few_ticks())
        title = model_style(model, style).title
        axes.set_title(wrapped(title, (size[0] - 1.2) / abreast, style), pad=3)
    figure.supxlabel(_LABELS["y_m"], fontsize=style.font_size)
    figure.supylabel(_LABELS["z_m"], fontsize=style.font_size)
    _add_laser_bar(figure, list(panels), colours)
    return figure


def _scatter(
    axes: Axes, scan: pd.DataFrame, across: str, upward: str, colours: ScalarMappable
) -> None:
    axes.scatter(
        scan[across],
        scan[upward],
        s=0.8,
        color=colours.to_rgba(scan["elevation_deg"].to_numpy()),
        linewidths=0,
        rasterized=True,
    )


def _few_ticks(most: int = 4) -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(most)


def _laser_colours(scan: pd.DataFrame) -> ScalarMappable:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    low, high = scan["elevation_deg"].min(), scan["elevation_deg"].max()
    reach = max(abs(low), abs(high), 1.0)
    return ScalarMappable(Normalize(-reach, reach), "viridis")


def _add_laser_bar(figure: Figure, axes: Any, colours: ScalarMappable, pad: float = 0.03) -> None:
    bar = figure.colorbar(colours, ax=axes, shrink=0.8, aspect=25, pad=pad)
    bar.set_label("Laser elevation (\u00b0)")
    bar.outline.set_linewidth(0.4)

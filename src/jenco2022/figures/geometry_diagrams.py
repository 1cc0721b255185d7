from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.geometry.cloud import Floats
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import COLUMN_WIDTH_IN, FigureStyle
from puckbench.tables.registry import STUDY
from virtual_lidar.sweep import Sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CODE = (
    "jenco2022.*",
    "virtual_lidar.residual_table",
    "virtual_lidar.sweep",
    "virtual_lidar.trajectory",
)

_figure = partial(FIGURES.register, category="Sensor")
_RAYS_DEG = (-15.0, -7.0, 1.0, 7.0, 15.0)
_WALL_M, _WALL_HEIGHT_M, _SENSOR_HEIGHT_M, _OPEN_RAY_M = 3.0, 2.2, 1.0, 2.6
_POSES = ("#0072B2", "#009E73", "#D55E00")
_NAMES_AT = ((1.0, 0.2), (1.6, 1.0), (1.75, 2.75))
_SURFACE: dict[str, Any] = {"color": "black", "linewidth": 1.5, "solid_capstyle": "butt"}
_HELP: dict[str, Any] = {"color": "black", "linewidth": 0.6, "linestyle": ":"}

_EYE = np.array([3.9, 1.6])
_INCIDENCES_DEG = (68.0, 25.0)
_ERROR_M = 0.75


@_figure("fig_5_1", title="The sweep in front of a wall", number="5.1", needs=(STUDY,))
def draw_sweep(style: FigureStyle) -> Figure:
    """The sweep of a single scan, seen from the side (thesis figure 5.1).

    The sensor pitches from -60° to +60°, 1 m above the floor and 1 to 5 m from a wall. Five of the
    sixteen rays are drawn at three pitches.
    """
    figure, axes = _canvas(2.6, style)
    sweep = Sweep()
    pitches = (sweep.pitch_start_deg, 0.0, sweep.pitch_end_deg)
    axes.plot([-0.6, _WALL_M, _WALL_M], [0, 0, _WALL_HEIGHT_M], **_SURFACE)
    for pitch, colour in zip(pitches, _POSES, strict=True):
        for elevation in _RAYS_DEG:
            end = ray_end(np.radians(pitch + elevation))
            axes.plot([0, end[0]], [_SENSOR_HEIGHT_M, end[1]], color=colour, linewidth=0.8)
    axes.plot(0, _SENSOR_HEIGHT_M, "s", color="black", markersize=6, zorder=3)
    _draw_turn(axes, sweep)
    _label_sweep(axes, pitches)
    return figure


def ray_end(angle: float) -> Floats:
    """Return where a ray ends, (2,), in m: on the wall, on the floor, or in the air after 2.6 m."""
    direction = np.array([np.cos(angle), np.sin(angle)])
    start = np.array([0.0, _SENSOR_HEIGHT_M])
    to_wall = _WALL_M / direction[0] if direction[0] > 1e-9 else np.inf
    to_floor = -_SENSOR_HEIGHT_M / direction[1] if direction[1] < -1e-9 else np.inf
    reach = min(to_wall, to_floor)
    end = start + min(reach, 1e6) * direction
    misses = reach == np.inf or end[1] > _WALL_HEIGHT_M
    return np.asarray(start + _OPEN_RAY_M * direction if misses else end)


def _draw_turn(axes: Axes, sweep: Sweep) -> None:
    angles = np.radians(np.linspace(sweep.pitch_start_deg, sweep.pitch_end_deg, 60))
    x, z = 0.75 * np.cos(angles), _SENSOR_HEIGHT_M + 0.75 * np.sin(angles)
    axes.plot(x, z, color="black", linewidth=0.9, zorder=3)
    arrow = {"arrowstyle": "-|>", "color": "black", "shrinkA": 0, "shrinkB": 0, "linewidth": 0.9}
    axes.annotate("", (x[-1], z[-1]), (x[-3], z[-3]), arrowprops=arrow, zorder=3)


def _label_sweep(axes: Axes, pitches: tuple[float, ...]) -> None:
    box = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
    for pitch, colour, at in zip(pitches, _POSES, _NAMES_AT, strict=True):
        axes.text(*at, f"pitch {_signed(pitch)}", color=colour, va="center", bbox=box)
    axes.text(-0.1, _SENSOR_HEIGHT_M, "Sensor", ha="right", va="center")
    axes.text(_WALL_M + 0.08, 1.6, "Wall", rotation=90, va="center")
    axes.text(-0.6, 0.06, "Floor", va="bottom")
    both = {"arrowstyle": "<->", "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (0, -0.18), (_WALL_M, -0.18), arrowprops=both)
    axes.text(_WALL_M / 2, -0.24, "1, 2, ..., 5 m", ha="center", va="top")
    axes.set_xlim(-0.75, _WALL_M + 0.4)
    axes.set_ylim(-0.5, _SENSOR_HEIGHT_M + _OPEN_RAY_M + 0.1)


def _signed(angle_deg: float) -> str:
    sign = "\u2212" if angle_deg < 0 else "+" if angle_deg > 0 else ""
    return f"{sign}{abs(angle_deg):g}\u00b0"


@_figure("fig_5_21", title="Incidence angle and plane residual", number="5.21", needs=(STUDY,))
def draw_incidence_geometry(style: FigureStyle) -> Figure:
    """Two returns from a floor with the same range error e (thesis figure 5.21).

    The plane residual (red) is d = e cos(theta), so that noise along the ray cannot widen residuals
    at large angles of incidence theta.
    """
    figure, axes = _canvas(2.1, style)
    axes.plot([-0.9, 4.3], [0, 0], **_SURFACE)
    for index, incidence in enumerate(np.radians(_INCIDENCES_DEG), start=1):
        _draw_sample(axes, index, float(incidence))
    axes.plot(*_EYE, "s", color="black", markersize=5)
    axes.text(_EYE[0] - 0.12, _EYE[1] + 0.05, "Sensor", ha="right", va="bottom")
    axes.set_xlim(-1.05, 4.35)
    axes.set_ylim(-1.0, 1.95)
    return figure


def residual_of(error_m: float, incidence_rad: float) -> float:
    """Return the plane residual that a range error causes at an angle of incidence."""
    return error_m * float(np.cos(incidence_rad))


def _draw_sample(axes: Axes, index: int, incidence: float) -> None:
    hit = np.array([_EYE[0] - _EYE[1] * np.tan(incidence), 0.0])
    along = np.array([-np.sin(incidence), -np.cos(incidence)])
    noisy = hit + _ERROR_M * along
    residual = residual_of(1.0, incidence)
    axes.plot(*zip(_EYE, hit, strict=True), **_HELP)
    axes.plot([hit[0]] * 2, [0, 0.95], **_HELP)
    axes.plot(*zip(hit, noisy, strict=True), color="black", linewidth=1.1)
    axes.plot([noisy[0]] * 2, [0, noisy[1]], color="#D55E00", linewidth=1.6)
    axes.plot(*hit, "o", color="white", markeredgecolor="black", markersize=4, zorder=3)
    axes.plot(*noisy, "o", color="#0072B2", markersize=5, zorder=3)
    _draw_angle(axes, hit, incidence, f"$\\theta_{index}$ = {np.degrees(incidence):.0f}\u00b0")
    middle = (hit + noisy) / 2
    axes.text(middle[0] + 0.08, middle[1] - 0.04, "$e$", ha="left", va="top")
    text = f"$d_{index}$ = $e$ cos $\\theta_{index}$\n= {residual:.2f} $e$"
    axes.text(noisy[0] - 0.16, noisy[1] - 0.14, text, color="#A03C00", ha="right", va="center")


def _draw_angle(axes: Axes, hit: Floats, incidence: float, text: str) -> None:
    angles = np.linspace(0, incidence, 30)
    radius = 0.6
    axes.plot(hit[0] + radius * np.sin(angles), radius * np.cos(angles), "k-", linewidth=0.7)
    axes.text(hit[0] - 0.07, 0.75, text, ha="right", va="center")


def _canvas(height_in: float, style: FigureStyle) -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(style.width_in or COLUMN_WIDTH_IN, height_in))
    axes = figure.subplots()
    axes.set_aspect("equal")
    axes.set_axis_off()
    return figure, axes

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from jenco2022.figures.model_styles import add_model_legend, model_style, ordered_models
from jenco2022.figures.residual_table import (
    check_residuals,
    compared,
    draw_violin,
    far,
    moments_text,
    near,
    residuals_of,
    subsample,
    symmetric_limit,
)
from jenco2022.published import PRINTED_STD_M
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from puckbench.figures.panels import wrapped
from puckbench.figures.registry import FIGURES, at
from puckbench.figures.style import COLUMN_WIDTH_IN, PAGE_WIDTH_IN, FigureStyle
from virtual_lidar.residual_table import REAL

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")

_figure = partial(FIGURES.register, category="Sensor")
SAMPLE = 100_000
_MIN_LIMIT_M, _MIN_MODELS_LIMIT_M = 0.15, 0.3
_SURFACES = ("wall", "floor")
RESIDUAL = "Plane residual (m)"
_GROUPS = {
    "distance_m": ("Distance from the wall (m)", 1),
    "elevation_deg": ("Laser elevation (\u00b0)", 2),
}


@_figure("fig_5_10", title="Plane residuals of walls and floors", number="5.10")
def draw_surfaces(residuals: pd.DataFrame, style: FigureStyle) -> Figure:
    """Plane residuals of walls and of floors nearer than 30 m, in metres (thesis figure 5.10).

    A plane residual is the signed distance of a return from the plane fitted to its surface. The
    virtual sensor's error model has beam divergence, if available. Violins show the density, mean
    and extremes of n residuals. If there is no capture, dashed lines show the standard deviation of
    the thesis's sensor.
    """
    check_residuals(residuals)
    rows = near(residuals)
    names = [name for name in _SURFACES if (rows["surface"] == name).any()]
    groups = {name.capitalize(): rows[rows["surface"] == name] for name in names}
    return _draw_groups(groups, "Surface", "", style)


@_figure("fig_5_11", title="Plane residuals of the wall per distance", number="5.11")
def draw_wall_distances(residuals: pd.DataFrame, style: FigureStyle) -> Figure:
    """Plane residuals of the wall by its distance from the sensor, in metres (thesis figure 5.11).

    Violins are drawn as in figure 5.10.
    """
    return _draw_grouped(residuals, "wall", "distance_m", style)


@_figure("fig_5_12", title="Plane residuals of the floor per distance", number="5.12")
def draw_floor_distances(residuals: pd.DataFrame, style: FigureStyle) -> Figure:
    """Plane residuals of the floor by the sensor's distance from the wall, in metres (thesis figure
    5.12).

    Violins are drawn as in figure 5.10.
    """
    return _draw_grouped(residuals, "floor", "distance_m", style)


@_figure("fig_5_13", title="Plane residuals of the floor per laser", number="5.13")
def draw_floor_lasers(residuals: pd.DataFrame, style: FigureStyle) -> Figure:
    """Plane residuals of the floor by laser, from all distances below 30 m (thesis figure 5.13).

    Residuals are in metres; violins are drawn as in figure 5.10.
    """
    return _draw_grouped(residuals, "floor", "elevation_deg", style)


@_figure("fig_5_14", title="Plane residuals of the wall per laser", number="5.14")
def draw_wall_lasers(residuals: pd.DataFrame, style: FigureStyle) -> Figure:
    """Plane residuals of the wall by laser, from all distances below 30 m (thesis figure 5.14,
    whose caption names the floor).

    Residuals are in metres; violins are drawn as in figure 5.10.
    """
    return _draw_grouped(residuals, "wall", "elevation_deg", style)


@_figure("fig_5_18", title="Plane residuals of the error models", number="5.18")
def draw_models(residuals: pd.DataFrame, style: FigureStyle) -> Figure:
    """Plane residuals of captures and of every error model, in metres (thesis figure 5.18).

    Surfaces are walls and floors nearer than 30 m. At most 100,000 random residuals of each model
    are drawn. The numbers below are the mean and standard deviation.
    """
    check_residuals(residuals)
    return _draw_models(near(residuals), _MIN_MODELS_LIMIT_M, style)


@_figure(
    "fig_5_19",
    title="Effect of beam divergence at 30 m",
    number="5.19",
    needs=(at(30), "vlp16", "vlp16_divergence"),
)
def draw_far_divergence(residuals: pd.DataFrame, style: FigureStyle) -> Figure:
    """Plane residuals at 30 m without and with beam divergence, in metres (thesis figure 5.19).

    At most 100,000 random residuals of each model are drawn. The numbers below are the mean and
    standard deviation.
    """
    check_residuals(residuals)
    rows = far(residuals)
    models = ("vlp16", "vlp16_divergence")
    for model in models:
        if not (rows["model"] == model).any():
            raise InputError(f"residual table: no row of the model {model!r} at 30 m")
    return _draw_models(rows[rows["model"].isin(models)], _MIN_LIMIT_M, style)


def _draw_grouped(residuals: pd.DataFrame, surface: str, column: str, style: FigureStyle) -> Figure:
    check_residuals(residuals, column)
    rows = near(residuals, surface)
    label, digits = _GROUPS[column]
    parts = rows.groupby(rows[column].round(digits))
    groups = {f"{key:g}".replace("-", "\u2212"): part for key, part in parts}
    return _draw_groups(groups, label, surface, style)


def _draw_groups(
    groups: Mapping[str, pd.DataFrame], label: str, surface: str, style: FigureStyle
) -> Figure:
    import pandas as pd

    models = compared(pd.concat(groups.values()))
    figure, axes = _panel(len(groups) * len(models), style)
    width = 0.8 / len(models)
    all_values: list[Floats] = []
    for place, part in enumerate(groups.values()):
        samples = {model: residuals_of(part, model) for model in models}
        samples = {model: values for model, values in samples.items() if len(values)}
        for index, (model, values) in enumerate(samples.items()):
            x = place + (index - (len(samples) - 1) / 2) * width
            draw_violin(axes, x, values, model_style(model, style).colour, 0.9 * width)
        all_values += samples.values()
    _set_axes(axes, list(groups), symmetric_limit(np.concatenate(all_values), _MIN_LIMIT_M))
    axes.set_xlabel(label)
    axes.set_title(", ".join(filter(None, (surface.capitalize(), _counts(all_values)))), pad=3)
    if REAL not in models:
        _show_published(axes, style)
    add_model_legend(figure, models, style)
    return figure


def _counts(samples: Sequence[Floats]) -> str:
    fewest, most = min(map(len, samples)), max(map(len, samples))
    return f"n = {fewest:,}" + ("" if fewest == most else f" to {most:,}") + " per violin"


def _show_published(axes: Axes, style: FigureStyle) -> None:
    colour = model_style(REAL, style).colour
    for side in (-PRINTED_STD_M, PRINTED_STD_M):
        axes.axhline(side, color=colour, linestyle="--", linewidth=0.8)


def _draw_models(rows: pd.DataFrame, min_limit_m: float, style: FigureStyle) -> Figure:
    models = ordered_models(rows["model"])
    figure, axes = _panel(2 * len(models), style)
    samples = {
        model: residuals_of(subsample(rows[rows["model"] == model], SAMPLE, model), model)
        for model in models
    }
    for place, (model, values) in enumerate(samples.items()):
        draw_violin(axes, place, values, model_style(model, style).colour, 0.7)
    limit = symmetric_limit(np.concatenate(list(samples.values())), min_limit_m)
    width_in = (figure.get_size_inches()[0] - 0.6) / len(models)
    titles = [wrapped(model_style(model, style).title, width_in, style) for model in models]
    _set_axes(axes, titles, limit)
    axes.set_title(_counts(list(samples.values())), pad=3)
    for place, values in enumerate(samples.values()):
        _write_moments(axes, place, values, limit)
    return figure


def _write_moments(axes: Axes, x: float, values: Floats, limit: float) -> None:
    axes.set_ylim(-1.32 * limit, limit)
    axes.axhline(-limit, color="black", linewidth=0.4)
    axes.text(x, -1.16 * limit, moments_text(values), ha="center", va="center", fontsize="small")


def _panel(violins: int, style: FigureStyle) -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure

    width = style.width_in or (COLUMN_WIDTH_IN if violins <= 10 else PAGE_WIDTH_IN)
    figure = Figure(figsize=(width, 2.4))
    axes = figure.subplots()
    axes.grid(visible=False, axis="x")
    axes.set_ylabel(RESIDUAL)
    return figure, axes


def _set_axes(axes: Axes, names: Sequence[str], limit: float) -> None:
    axes.set_xticks(range(len(names)), names)
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.set_ylim(-limit, limit)

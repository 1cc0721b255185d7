from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jenco2022.figures.model_styles import model_style, ordered_models
from jenco2022.figures.residual_table import residuals_of, violin_shape
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from puckbench.figures.axis_labels import BETTER
from puckbench.figures.checks import require_rows
from puckbench.figures.panels import add_rows_legend, set_log
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import COLUMN_WIDTH_IN, FigureStyle
from virtual_lidar.residual_table import REAL

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")

_DISTANCES = ("model", "std_m", "emd_m", "chance_m")
_MIN_REACH_M = 0.04
_REACH_SIGMAS = 4.0
_LINES = ("-", "--", "-.", ":")


@FIGURES.register(
    "model_verdict", title="Real wall residuals against the error models", category="Sensor"
)
def draw_verdict(
    compared_residuals: pd.DataFrame, model_distances: pd.DataFrame, style: FigureStyle
) -> Figure:
    """Plane residuals of captured walls, and of error models simulated on the same rays.

    The upper panel shows densities; n is the number of real residuals. The lower panel shows the
    earth mover's distance of each model's residuals from those of the real sensor, in mm. A sensor
    that follows the model exceeds the grey bar with a probability of 5 %.
    """
    from matplotlib.figure import Figure

    require_rows(compared_residuals, ("model", "residual_m"), "comparison")
    require_rows(model_distances, _DISTANCES[:-1], "distance")
    if not (compared_residuals["model"] == REAL).any():
        raise InputError("comparison table: no real residuals")
    models = [name for name in ordered_models(model_distances["model"]) if name != REAL]
    width = style.width_in or COLUMN_WIDTH_IN
    figure = Figure(figsize=(width, 2.1 + 0.95 + 0.2 * len(models)))
    above, below = figure.subplots(2, 1, height_ratios=[2.1, 0.35 + 0.2 * len(models)])
    _draw_densities(above, compared_residuals, models, style)
    _draw_distances(below, model_distances.set_index("model"), models, style)
    handles, _ = above.get_legend_handles_labels()
    add_rows_legend(figure, handles, 3, fontsize="small", handlelength=2.2)
    return figure


def _draw_densities(axes: Axes, table: pd.DataFrame, models: list[str], style: FigureStyle) -> None:
    real = residuals_of(table, REAL)
    reach = max(_REACH_SIGMAS * float(real.std()), _MIN_REACH_M)
    plot_style = model_style(REAL, style)
    coords, density = _density(real)
    axes.fill_between(coords * 1e3, density, color=plot_style.colour, alpha=0.35, linewidth=0)
    axes.plot(coords * 1e3, density, color=plot_style.colour, linewidth=0.6, label=plot_style.title)
    for index, name in enumerate(models):
        values = residuals_of(table, name)
        if len(values) == 0:
            raise InputError(f"comparison table: no residual of the model {name!r}")
        coords, density = _density(values)
        plot_style = model_style(name, style)
        line = _LINES[index % len(_LINES)]
        axes.plot(coords * 1e3, density, line, color=plot_style.colour, label=plot_style.title)
    axes.set_xlim(-reach * 1e3, reach * 1e3)
    axes.set_ylim(bottom=0)
    axes.set_title(f"n = {len(real):,}", pad=3)
    axes.set_xlabel("Plane residual of the walls (mm)")
    axes.set_ylabel("Density (1/mm)")


def _draw_distances(axes: Axes, rows: pd.DataFrame, models: list[str], style: FigureStyle) -> None:
    for place, name in enumerate(models):
        value, chance = rows.loc[name, list(_DISTANCES[2:])].to_numpy(float) * 1e3
        colour = model_style(name, style).colour
        if np.isfinite(chance):
            axes.barh(place, chance, height=0.7, color="#bbbbbb", alpha=0.6, linewidth=0)
        axes.plot(value, place, "o", color=colour)
        axes.annotate(
            f"{value:.1f}", (value, place), (4, 0), textcoords="offset points",
            va="center", fontsize="small",
        )  # fmt: skip
    set_log(axes, "x", _limits(rows.loc[models]), minor=False)
    axes.set_yticks(range(len(models)), [model_style(name, style).title for name in models])
    axes.set_ylim(len(models) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xlabel(f"Earth mover's distance to the real ones (mm), {BETTER}")


def _limits(rows: pd.DataFrame) -> tuple[float, float]:
    low = 0.6 * float(np.nanmin(rows[["emd_m", "chance_m"]].to_numpy(float))) * 1e3
    return max(low, 1e-3), 2.5 * float(rows["emd_m"].max()) * 1e3


def _density(residuals: Floats) -> tuple[Floats, Floats]:
    shape = violin_shape(residuals)
    return np.asarray(shape["coords"]), np.asarray(shape["vals"]) / 1e3

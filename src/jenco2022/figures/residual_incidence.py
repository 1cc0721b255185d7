from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from jenco2022.figures.model_styles import counted, model_style, ordered_models, source_title
from jenco2022.figures.residual_table import (
    binned_moments,
    check_residuals,
    compared,
    near,
    subsample,
    symmetric_limit,
)
from jenco2022.figures.residual_violins import RESIDUAL
from jenco2022.published import BIN_STDS_M, LARGEST_RAD, PRINTED_MEAN_M
from pointkit.geometry.cloud import Floats
from puckbench.figures.panels import add_fitting_legend, panel_grid
from puckbench.figures.registry import FIGURES
from puckbench.figures.style import FigureStyle
from virtual_lidar.residual_table import REAL

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")

_figure = partial(FIGURES.register, category="Sensor")
SAMPLE = 30_000
BIN_RAD = LARGEST_RAD / len(BIN_STDS_M)
_MIN_LIMIT_M, _MIN_BINS_LIMIT_M = 0.1, 0.05
_DISCOUNTED = ("hdl64e", "vlp16_table51")
_LONG_COLUMN = 5
_INCIDENCE = "Incidence angle (rad)"


@_figure("fig_5_15", title="Plane residuals against incidence", number="5.15")
def draw_incidence(residuals: pd.DataFrame, style: FigureStyle) -> Figure:
    """Plane residuals of walls and floors against the angle of incidence (thesis figure 5.15).

    The upper panels show n random returns, at most 30,000. The last panel shows the mean and
    standard deviation in bins of the thesis's width. If there is no capture, the dashed line shows
    the values of the thesis's sensor.
    """
    check_residuals(residuals, "incidence_rad")
    rows = near(residuals)
    models = compared(rows)
    samples = _samples(rows, models)
    figure, panels = panel_grid(len(models) + 1, 1, 1.35, style, sharey="row")
    for axes, model in zip(panels, models, strict=False):
        _scatter(axes, samples[model], model_style(model, style).colour)
        axes.set_title(counted(source_title(model, style), len(samples[model][0])), pad=3)
    _finish(figure, panels, samples, 1, style)
    _draw_bins(panels[-1], samples, style)
    handles, _ = panels[-1].get_legend_handles_labels()
    add_fitting_legend(figure, handles, style)
    return figure


@_figure("fig_5_20", title="Plane residuals against incidence, per error model", number="5.20")
def draw_incidence_of_models(residuals: pd.DataFrame, style: FigureStyle) -> Figure:
    """Plane residuals against the angle of incidence by error model (thesis figure 5.20).

    Points are a random sample of n returns, at most 30,000. Black lines are one standard deviation
    around the mean, in bins of the thesis's width. As in the thesis, two models are left out as too
    noisy: the HDL-64E's, and that of Table 5.1 as printed.
    """
    check_residuals(residuals, "incidence_rad")
    rows = near(residuals)
    models = ordered_models(rows["model"])
    shown = [model for model in models if model not in _DISCOUNTED]
    samples = _samples(rows, shown or models)
    columns = 1 if len(samples) <= _LONG_COLUMN else 2
    figure, panels = panel_grid(len(samples), columns, 1.1, style)
    for axes, (model, (incidence, values)) in zip(panels, samples.items(), strict=True):
        plot_style = model_style(model, style)
        _scatter(axes, (incidence, values), plot_style.colour)
        centres, means, stds = binned_moments(incidence, values, BIN_RAD)
        for side in (-1, 1):
            axes.plot(centres, means + side * stds, color="black", linewidth=0.8)
        axes.set_title(counted(plot_style.title, len(values)), pad=3)
    _finish(figure, panels, samples, columns, style)
    return figure


Sample = tuple[Floats, Floats]


def _samples(rows: pd.DataFrame, models: Sequence[str]) -> dict[str, Sample]:
    parts = {model: subsample(rows[rows["model"] == model], SAMPLE, model) for model in models}
    return {
        model: (
            part["incidence_rad"].to_numpy(dtype=np.float64),
            part["residual_m"].to_numpy(dtype=np.float64),
        )
        for model, part in parts.items()
    }


def _scatter(axes: Axes, sample: Sample, colour: str) -> None:
    # Rasterised, since PDF viewers draw 30,000 points slowly.
    axes.scatter(*sample, s=0.8, color=colour, alpha=0.5, linewidths=0, rasterized=True)


def _draw_bins(axes: Axes, samples: dict[str, Sample], style: FigureStyle) -> None:
    bars = {model: binned_moments(*sample, BIN_RAD) for model, sample in samples.items()}
    titles = {model: source_title(model, style) for model in bars}
    if REAL not in bars:
        bars = {REAL: _published(), **bars}
        titles[REAL] = "Thesis's VLP-16 (not captured)"
    widest = max(float(centres[-1]) for centres, _, _ in bars.values())
    for index, (model, (centres, means, stds)) in enumerate(bars.items()):
        line = "--" if model not in samples else "-"
        shift = (index - (len(bars) - 1) / 2) * 0.015 * widest
        colour = model_style(model, style).colour
        axes.errorbar(
            centres + shift,
            means,
            stds,
            color=colour,
            linestyle=line,
            capsize=1.5,
            label=titles[model],
        )
    ends = [mean + side * std for _, mean, std in bars.values() for side in (-1, 1)]
    limit = symmetric_limit(np.nan_to_num(np.concatenate(ends)), _MIN_BINS_LIMIT_M)
    axes.set_ylim(-limit, limit)
    axes.set_title(f"Mean and standard deviation in bins of {BIN_RAD:.2g} rad", pad=3)


def _published() -> tuple[Floats, Floats, Floats]:
    stds = np.array(BIN_STDS_M)
    centres = np.asarray((np.arange(len(stds)) + 0.5) * BIN_RAD, dtype=np.float64)
    return centres, np.full(len(stds), PRINTED_MEAN_M), stds


def _finish(
    figure: Figure, panels: list[Axes], samples: dict[str, Sample], columns: int, style: FigureStyle
) -> None:
    limit = symmetric_limit(
        np.concatenate([values for _, values in samples.values()]), _MIN_LIMIT_M
    )
    for axes in panels:
        axes.set_ylim(-limit, limit)
    largest = max(float(incidence.max()) for incidence, _ in samples.values())
    panels[0].set_xlim(-0.02 * largest, 1.05 * max(largest, 0.1))
    for axes in panels[-columns:]:
        axes.set_xlabel(_INCIDENCE)
    figure.supylabel(RESIDUAL, fontsize=style.font_size)

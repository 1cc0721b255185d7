from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from jenco2022.figures.model_styles import ordered_models
from jenco2022.published import FAR_M
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.seeding import generator, random_rows
from puckbench.figures.checks import require_rows
from virtual_lidar.residual_table import REAL

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")

_STEP_M = 0.05
_FEWEST_BINS, _MOST_BINS = 128, 4096
_VIRTUAL = ("vlp16_divergence", "vlp16")


def check_residuals(table: pd.DataFrame, *columns: str) -> None:
    """Raise InputError if a table of residuals cannot be drawn.

    This is so if it has no rows, lacks a column, or has a number that is not finite. `columns` are
    names of further columns that must contain finite numbers.
    """
    require_rows(table, ("model", "surface", "distance_m", "residual_m", *columns), "residual")
    for name in ("distance_m", "residual_m", *columns):
        if table[name].dtype.kind not in "fiu":
            raise InputError(f"residual table: column {name!r} has values that are not numbers")
        if not np.isfinite(table[name].to_numpy(dtype=float)).all():
            raise InputError(f"residual table: column {name!r} has a missing or infinite value")


def near(table: pd.DataFrame, surface: str | None = None) -> pd.DataFrame:
    """Return the residuals nearer than `FAR_M`, of one surface or, by default, of all."""
    rows = table["distance_m"] < FAR_M
    if surface is not None:
        rows &= table["surface"] == surface
    if not rows.any():
        raise InputError(f"residual table: no {surface or 'surface'} nearer than {FAR_M:g} m")
    return table[rows]


def far(table: pd.DataFrame) -> pd.DataFrame:
    """Return the residuals of surfaces at `FAR_M` or farther."""
    rows = table["distance_m"] >= FAR_M
    if not rows.any():
        raise InputError(f"residual table: no surface at {FAR_M:g} m or farther")
    return table[rows]


def compared(table: pd.DataFrame) -> list[str]:
    """Return the names of the models that a figure compares: the real sensor and a virtual one.

    The virtual one is the first of `_VIRTUAL` that the table has; if it has none of them, it is the
    table's first error model. The real sensor (`REAL`) is left out if the table has no captures.
    """
    models = [model for model in ordered_models(table["model"]) if model != REAL]
    preferred = [model for model in _VIRTUAL if model in models]
    virtual = (preferred or models)[:1]
    return [REAL, *virtual] if (table["model"] == REAL).any() else virtual


def subsample(table: pd.DataFrame, size: int, name: str) -> pd.DataFrame:
    """Return at most `size` rows, chosen at random; `name` determines the seed."""
    return table.iloc[random_rows(len(table), size, generator(0, "figure", name))]


def residuals_of(table: pd.DataFrame, model: str) -> Floats:
    """Return the residuals of a model, (n,), in m."""
    return np.asarray(table.loc[table["model"] == model, "residual_m"], dtype=np.float64)


def binned_moments(x: Floats, y: Floats, width: float) -> tuple[Floats, Floats, Floats]:
    """Return mean and standard deviation of y in bins of x.

    Parameters
    ----------
    x, y
        Values, (n,); x is not negative.
    width
        Width of a bin; the first bin begins at x = 0.

    Returns
    -------
    centres, means, stds
        Arrays with one value for each of k bins, (k,); nan for bins with fewer than two values.
    """
    bin_of = (x / width).astype(int)
    bins = np.arange(bin_of.max(initial=0) + 1)
    parts = [y[bin_of == index] for index in bins]
    means = [part.mean() if len(part) > 1 else np.nan for part in parts]
    stds = [part.std() if len(part) > 1 else np.nan for part in parts]
    return (bins + 0.5) * width, np.array(means), np.array(stds)


def draw_violin(axes: Axes, at: float, residuals: Floats, colour: str, width: float) -> None:
    """Draw the distribution of residuals as a violin at the position `at` of the axis."""
    bodies = axes.violin([violin_shape(residuals)], [at], widths=width, showmeans=True)
    parts: dict[str, Any] = dict(bodies)
    for body in parts.pop("bodies"):
        body.set(facecolor=colour, edgecolor="none", alpha=0.4)
    for line in parts.values():
        line.set(color=colour, linewidth=0.7)


def violin_shape(residuals: Floats) -> dict[str, Any]:
    """Return the statistics of residuals (n,) that matplotlib's `Axes.violin` draws.

    The density is estimated with a Gaussian kernel of Scott's width.
    """
    low, high, std = float(residuals.min()), float(residuals.max()), float(residuals.std())
    shape: dict[str, Any] = {
        "mean": float(residuals.mean()),
        "median": float(np.median(residuals)),
        "min": low,
        "max": high,
    }
    if std <= 1e-12 * max(abs(low), abs(high)):
        return {**shape, "coords": np.array([low]), "vals": np.array([1.0])}
    coords, density = _density(residuals, std * len(residuals) ** -0.2)
    return {**shape, "coords": coords, "vals": density}


def _density(residuals: Floats, bandwidth: float) -> tuple[Floats, Floats]:
    low, high = float(residuals.min()), float(residuals.max())
    bins = int(np.clip(4 * (high - low) / bandwidth, _FEWEST_BINS, _MOST_BINS))
    density, edges = np.histogram(residuals, bins, (low, high), density=True)
    sigma = bandwidth / (edges[1] - edges[0])
    reach = min(math.ceil(4 * sigma), (bins - 1) // 2)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(sigma, 1e-9)) ** 2)
    smooth = np.convolve(density, kernel / kernel.sum(), mode="same")
    return (edges[1:] + edges[:-1]) / 2, np.asarray(smooth, dtype=np.float64)


def symmetric_limit(residuals: Floats, min_m: float) -> float:
    """Return the limit, in m, of an axis from minus the limit to the limit.

    It is the largest absolute residual, rounded up to 5 cm, but at least `min_m`.
    """
    largest = float(np.abs(residuals).max(initial=0.0))
    if largest <= min_m:
        return min_m
    return math.ceil(largest / _STEP_M) * _STEP_M


def moments_text(residuals: Floats) -> str:
    """Return mean and standard deviation of residuals as text."""
    mean, std = residuals.mean() + 0.0, residuals.std()
    return f"$\\mu$ = {_zero_unsigned(mean)}\n$\\sigma$ = {std:.3f}"


def _zero_unsigned(value: float) -> str:
    text = f"{value:.3f}"
    return "0.000" if text == "-0.000" else text.replace("-", "\u2212")

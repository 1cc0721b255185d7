from __future__ import annotations

from typing import TYPE_CHECKING

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

_VIRTUAL = ("vlp16_divergence", "vlp16")


def check_residuals(table: pd.DataFrame, *columns: str) -> None:
    """Raise InputError if the table has no rows or a number is not finite."""
    require_rows(table, ("model", "surface", "distance_m", "residual_m", *columns), "residual")
    for name in ("distance_m", "residual_m", *columns):
        if table[name].dtype.kind not in "fiu":
            raise InputError(f"residual table: column {name!r} has values that are not numbers")
        if not np.isfinite(table[name].to_numpy(dtype=float)).all():
            raise InputError(f"residual table: column {name!r} has a missing or infinite value")


def near(table: pd.DataFrame, surface: str | None = None) -> pd.DataFrame:
    rows = table["distance_m"] < FAR_M
    if surface is not None:
        rows &= table["surface"] == surface
    if not rows.any():
        raise InputError(f"residual table: no {surface or 'surface'} nearer than {FAR_M:g} m")
    return table[rows]


def far(table: pd.DataFrame) -> pd.DataFrame:
    rows = table["distance_m"] >= FAR_M
    if not rows.any():
        raise InputError(f"residual table: no surface at {FAR_M:g} m or farther")
    return table[rows]


def compared(table: pd.DataFrame) -> list[str]:
    """Return the error models to compare: `REAL`, if the table has it, and a virtual one.

    The virtual one is the first of `_VIRTUAL` in the table, else the table's first.
    """
    models = [model for model in ordered_models(table["model"]) if model != REAL]
    preferred = [model for model in _VIRTUAL if model in models]
    virtual = (preferred or models)[:1]
    return [REAL, *virtual] if (table["model"] == REAL).any() else virtual


def subsample(table: pd.DataFrame, size: int, name: str) -> pd.DataFrame:
    """Return at most `size` rows, chosen at random with a seed from `name`."""
    return table.iloc[random_rows(len(table), size, generator(0, "figure", name))]


def residuals_of(table: pd.DataFrame, model: str) -> Floats:
    return np.asarray(table.loc[table["model"] == model, "residual_m"], dtype=np.float64)


def binned_moments(x: Floats, y: Floats, width: float) -> tuple[Floats, Floats, Floats]:
    """Return bin centres of x, and means and standard deviations of y, for bins from x = 0."""
    bin_of = (x / width).astype(int)
    bins = np.arange(bin_of.max(initial=0) + 1)
    parts = [y[bin_of == index] for index in bins]
    means = [part.mean() if len(part) > 1 else np.nan for part in parts]
    stds = [part.std() if len(part) > 1 else np.nan for part in parts]
    return (bins + 0.5) * width, np.array(means), np.array(stds)

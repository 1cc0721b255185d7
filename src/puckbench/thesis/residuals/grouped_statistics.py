from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

if TYPE_CHECKING:
    import pandas as pd

QUANTILES = {"q05": 0.05, "q25": 0.25, "q50": 0.50, "q75": 0.75, "q95": 0.95}
PER_LASER = ("model", "surface", "distance_m", "laser_id")


def grouped_statistics(table: pd.DataFrame, by: Sequence[str] = PER_LASER) -> pd.DataFrame:
    """Return ``count``, ``mean_m``, ``std_m`` (n - 1) and quantiles of residuals by group."""
    residuals = table["residual_m"].astype(np.float64)
    groups = residuals.groupby([table[name] for name in by], observed=True)
    result = groups.agg(["count", "mean", "std"])
    for name, level in QUANTILES.items():
        result[name] = groups.quantile(level)
    names = {name: f"{name}_m" for name in ("mean", "std", *QUANTILES)}
    return result.rename(columns=names).reset_index()


def incidence_bins(
    table: pd.DataFrame,
    bins: int = 10,
    *,
    by: Sequence[str] = ("model",),
    highest_rad: float | None = None,
) -> pd.DataFrame:
    """Return mean and standard deviation of residuals in equal bins of the incidence angle.

    They go from 0 to `highest_rad`, by default the largest. Raises InputError without rows or bins.
    """
    if table.empty or bins < 1:
        raise InputError("incidence bins need at least one residual and one bin")
    angles = table["incidence_rad"].to_numpy(dtype=np.float64)
    highest = float(angles.max()) if highest_rad is None else highest_rad
    within = table.assign(bin=_bins(angles, bins, highest))[angles <= highest]
    result = grouped_statistics(within, (*by, "bin"))
    result.insert(len(by), "low_rad", result["bin"] * (highest / bins))
    result.insert(len(by) + 1, "high_rad", (result["bin"] + 1) * (highest / bins))
    return result[[*by, "low_rad", "high_rad", "count", "mean_m", "std_m"]]


def _bins(angles: Floats, bins: int, highest: float) -> Floats:
    numbers = np.zeros(len(angles)) if highest == 0 else np.floor(angles * (bins / highest))
    return np.minimum(numbers, bins - 1)

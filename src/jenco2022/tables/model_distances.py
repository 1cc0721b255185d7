from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jenco2022.figures.model_styles import ordered_models
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from puckbench.tables.registry import SENSOR, TABLES
from virtual_lidar.residual_table import REAL

if TYPE_CHECKING:
    import pandas as pd

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")


_BIN_M, _REACH_M = 2e-4, 0.5
_BINS = round(2 * _REACH_M / _BIN_M)


_COLUMNS = {
    "residuals": "Residuals",
    "emd_m": "Earth mover's distance",
    "chance_m": "Distance that chance exceeds in 5 %",
}


@TABLES.register(
    "model_distances",
    title="How far error models are from real walls",
    category=SENSOR,
    columns=_COLUMNS,
)
def model_distances(compared: pd.DataFrame) -> pd.DataFrame:
    """Earth mover's distance of each error model's wall residuals from those of real sensors.

    Distances are in metres. A sensor that follows the model exceeds the distance ``chance_m`` with
    5 % probability. There are no intervals, because walls and lasers of one device are not a sample
    of devices.

    Parameters
    ----------
    compared
        Table of `compared_residuals`.

    Raises
    ------
    InputError
        There are no real residuals.
    """
    import pandas as pd

    if not (compared["model"] == REAL).any():
        raise InputError("the comparison has no real residuals")
    real = _histogram(compared[compared["model"] == REAL])
    rows = []
    for name in ordered_models(compared["model"].astype(str)):
        residuals = compared[compared["model"] == name]
        simulated = _histogram(residuals)
        rows.append(
            {
                "model": name,
                "residuals": len(residuals),
                "std_m": float(residuals["residual_m"].std()),
                "emd_m": _distance(real, simulated),
                "chance_m": _chance(residuals, simulated),
            }
        )
    return pd.DataFrame(rows)


def _histogram(rows: pd.DataFrame) -> Floats:
    bins = _bins(rows["residual_m"].to_numpy(dtype=np.float64))
    return np.bincount(bins, minlength=_BINS).astype(np.float64)


def _bins(residuals: Floats) -> NDArray[np.int64]:
    numbers = np.floor((residuals + _REACH_M) / _BIN_M).astype(np.int64)
    return np.clip(numbers, 0, _BINS - 1)


def _distance(histogram: Floats, other: Floats) -> float:
    difference = np.cumsum(histogram) / histogram.sum() - np.cumsum(other) / other.sum()
    return float(np.abs(difference).sum() * _BIN_M)


def _chance(rows: pd.DataFrame, total: Floats) -> float:
    """Return the 95 % quantile of the distances, in m, of single replicates from all residuals."""
    residuals = rows["residual_m"].to_numpy(dtype=np.float64)
    parts = rows.groupby("replicate").indices.values()
    if len(parts) < 2:
        return float("nan")
    histograms = [np.bincount(_bins(residuals[part]), minlength=_BINS) for part in parts]
    distances = [_distance(histogram.astype(np.float64), total) for histogram in histograms]
    return float(np.quantile(distances, 0.95))

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.core.seeding import generator
from puckbench.geometry.cloud import Floats
from puckbench.lidar.residual_table import REAL
from puckbench.metrics.table_registry import SENSOR, TABLES
from puckbench.thesis.figures.model_styles import ordered_models
from puckbench.thesis.residuals.compared import WALL_KEYS

if TYPE_CHECKING:
    import pandas as pd


RESAMPLES = 300
_BIN_M, _REACH_M = 2e-4, 0.5
_BINS = round(2 * _REACH_M / _BIN_M)


@TABLES.register(
    "model_distances", title="How far error models are from real walls", category=SENSOR
)
def model_distances(
    compared: pd.DataFrame, *, resamples: int = RESAMPLES, seed: int = 0
) -> pd.DataFrame:
    """Earth mover's distance of each error model's wall residuals from those of real sensors.

    Distances are in metres, with 95 % intervals. A sensor that follows the model exceeds the
    distance ``chance_m`` with 5 % probability.

    Parameters
    ----------
    compared
        Table of `compared_residuals`.
    resamples
        Number of bootstrap samples of pairs (wall, laser); residuals of a pair share a bias.

    Raises
    ------
    InputError
        There are no real residuals.
    """
    import pandas as pd

    if not (compared["model"] == REAL).any():
        raise InputError("the comparison has no real residuals")
    real = _block_counts(compared[compared["model"] == REAL])
    rows = []
    for name in ordered_models(compared["model"].astype(str)):
        residuals = compared[compared["model"] == name]
        blocks = _block_counts(residuals)
        rng = generator(seed, "model distances", name)
        samples = [(_resampled(real, rng), _resampled(blocks, rng)) for _ in range(resamples)]
        low, high = np.quantile([_distance(a, b) for a, b in samples], [0.025, 0.975])
        rows.append(
            {
                "model": name,
                "residuals": len(residuals),
                "std_m": float(residuals["residual_m"].std()),
                "emd_m": _distance(real.sum(axis=0), blocks.sum(axis=0)),
                "emd_low_m": float(low) if name != REAL else 0.0,
                "emd_high_m": float(high) if name != REAL else 0.0,
                "chance_m": _chance(residuals, blocks.sum(axis=0)),
            }
        )
    return pd.DataFrame(rows)


def _block_counts(rows: pd.DataFrame) -> Floats:
    """Return a histogram of residuals for each wall and laser, (blocks, bins)."""
    block = np.asarray(rows.groupby(["replicate", *WALL_KEYS, "laser_id"]).ngroup())
    bins = _bins(rows["residual_m"].to_numpy(dtype=np.float64))
    blocks = int(block.max()) + 1
    counts = np.bincount(block * _BINS + bins, minlength=blocks * _BINS)
    return counts.reshape(blocks, _BINS).astype(np.float64)


def _resampled(counts: Floats, rng: np.random.Generator) -> Floats:
    blocks = len(counts)
    weights = np.bincount(rng.integers(blocks, size=blocks), minlength=blocks)
    return np.asarray(weights @ counts)


def _bins(residuals: Floats) -> NDArray[np.int64]:
    numbers = np.floor((residuals + _REACH_M) / _BIN_M).astype(np.int64)
    return np.clip(numbers, 0, _BINS - 1)


def _distance(histogram: Floats, other: Floats) -> float:
    difference = np.cumsum(histogram) / histogram.sum() - np.cumsum(other) / other.sum()
    return float(np.abs(difference).sum() * _BIN_M)


def _chance(rows: pd.DataFrame, total: Floats) -> float:
    """Return the 95 % quantile of distances (m) between each replicate and all residuals (`total`);
    nan for fewer than two replicates.
    """
    residuals = rows["residual_m"].to_numpy(dtype=np.float64)
    parts = rows.groupby("replicate").indices.values()
    if len(parts) < 2:
        return float("nan")
    histograms = [np.bincount(_bins(residuals[part]), minlength=_BINS) for part in parts]
    distances = [_distance(histogram.astype(np.float64), total) for histogram in histograms]
    return float(np.quantile(distances, 0.95))

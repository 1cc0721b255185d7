"""Detection of losslessly coded clouds, whose errors come only from rounding of coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import PointCloud, bounds

if TYPE_CHECKING:
    import pandas as pd

LOSSLESS = "lossless"
"""Column of result rows: whether all errors are rounding errors."""
_ROUNDING = 2.0**-21
"""Four units in the last place of single precision: a coordinate is rounded when it is read, by two
operations of a decoder and when it is written, along three axes."""
_MOST = 1e-4
"""Metres; larger errors are never attributed to rounding."""
_OF_THE_SHAPE = ("d1_", "d2_", "cd_", "acd_", "hausdorff_", "view_")
"""Prefixes of columns that compare the decoded with the coded cloud."""
_BEST_DB, MOST_DB = 1e9, 1e4
"""Value of a lossless cloud's PSNR when quantiles are computed, and a limit that no lossy cloud
reaches."""
_COUNTS = ("points_a", "points_b")


def rounding(cloud: PointCloud) -> float:
    """Return the largest error that rounding of coordinates can cause, in the cloud's unit."""
    limit = _ROUNDING * float(np.abs(bounds(cloud.xyz)).max())
    return limit if cloud.frame == "scaled" else min(limit, _MOST)


def without_rounding(errors: Mapping[str, float], limit: float) -> dict[str, float]:
    """Set errors from `distortion` to 0 if none exceeds `limit`, and add the entry `LOSSLESS`."""
    is_lossless = errors["hausdorff_point"] <= limit
    kept = {k: 0.0 if is_lossless and k not in _COUNTS else v for k, v in errors.items()}
    return {**kept, LOSSLESS: is_lossless}


def lossless_rows(metrics: pd.DataFrame) -> NDArray[np.bool_]:
    """Return a mask (n,) of lossless rows: the column `LOSSLESS` or, without it, errors of 0."""
    flags = metrics.get(LOSSLESS)
    by_error = np.zeros(len(metrics), bool)
    if {"hausdorff_point", "diameter"} <= set(metrics):
        by_error = (metrics["hausdorff_point"] <= _ROUNDING * metrics["diameter"]).to_numpy()
    elif "d1_mse" in metrics:
        by_error = (metrics["d1_mse"] == 0).to_numpy()
    if flags is None:
        return by_error
    return np.where(flags.isna(), by_error, flags.eq(True)).astype(bool)


def with_lossless_best(metrics: pd.DataFrame) -> pd.DataFrame:
    """Replace infinite PSNRs (lossless) by a finite value above all others, for quantiles."""
    psnrs = [name for name in map(str, metrics) if "_psnr" in name and is_shape_metric(name)]
    rows = lossless_rows(metrics)
    return metrics.assign(**{name: metrics[name].mask(rows, _BEST_DB) for name in psnrs})


def without_lossless(quantiles: pd.DataFrame) -> pd.DataFrame:
    """Remove the values of `with_lossless_best` from quantiles."""
    psnrs = [name for name in map(str, quantiles) if "_psnr" in name]
    return quantiles.assign(**{n: quantiles[n].mask(quantiles[n] > MOST_DB) for n in psnrs})


def is_shape_metric(column: str) -> bool:
    return column.startswith(_OF_THE_SHAPE)

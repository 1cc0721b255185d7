"""Which decoded clouds are lossless: their errors come from the rounding of numbers, not coding."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import PointCloud, bounds

if TYPE_CHECKING:
    import pandas as pd

LOSSLESS = "lossless"
"""Column of result rows: whether every point came back, but for the rounding of numbers."""
_ROUNDING = 2.0**-21
"""Four units in the last place of single precision: a coordinate is rounded as it is read, in two
operations of a decoder and as it is written, along three axes."""
_MOST = 1e-4
"""Errors above this are errors, however large coordinates in metres are."""
_OF_THE_SHAPE = ("d1_", "d2_", "cd_", "acd_", "hausdorff_", "view_")
"""How columns begin that measure a decoded cloud against the coded one."""
_BEST_DB, MOST_DB = 1e9, 1e4
"""What stands for a lossless cloud's PSNR in quantiles, and what no lossy cloud reaches."""
_COUNTS = ("points_a", "points_b")


def rounding(cloud: PointCloud) -> float:
    """Distance, in the cloud's units, up to which a decoded point is the point that was coded."""
    limit = _ROUNDING * float(np.abs(bounds(cloud.xyz)).max())
    return limit if cloud.frame == "scaled" else min(limit, _MOST)


def without_rounding(errors: Mapping[str, float], limit: float) -> dict[str, float]:
    """The errors with the entry `LOSSLESS`; all are 0 where none is above `limit`.

    Parameters
    ----------
    errors
        Of `puckbench.metrics.geometry.distortion`.
    limit
        Of `rounding`.
    """
    is_lossless = errors["hausdorff_point"] <= limit
    kept = {k: 0.0 if is_lossless and k not in _COUNTS else v for k, v in errors.items()}
    return {**kept, LOSSLESS: is_lossless}


def lossless_rows(metrics: pd.DataFrame) -> NDArray[np.bool_]:
    """Which result rows (n,) are lossless; rows of older runs are judged by their errors."""
    marked = metrics.get(LOSSLESS)
    found = np.zeros(len(metrics), bool)
    if {"hausdorff_point", "diameter"} <= set(metrics):
        found = (metrics["hausdorff_point"] <= _ROUNDING * metrics["diameter"]).to_numpy()
    elif "d1_mse" in metrics:
        found = (metrics["d1_mse"] == 0).to_numpy()
    if marked is None:
        return found
    return np.where(marked.isna(), found, marked.eq(True)).astype(bool)


def with_lossless_best(metrics: pd.DataFrame) -> pd.DataFrame:
    """Result rows in which lossless clouds have a PSNR that is better than any other.

    Quantiles over clouds then count them, and do not leave out the best; `without_lossless` makes
    quantiles that are lossless themselves empty. Such a PSNR is not infinite, as between a finite
    and an infinite value nothing can be interpolated.
    """
    psnrs = [name for name in map(str, metrics) if "_psnr" in name and is_of_the_shape(name)]
    rows = lossless_rows(metrics)
    return metrics.assign(**{name: metrics[name].mask(rows, _BEST_DB) for name in psnrs})


def without_lossless(quantiles: pd.DataFrame) -> pd.DataFrame:
    """Quantiles of the rows of `with_lossless_best` without those that are lossless."""
    psnrs = [name for name in map(str, quantiles) if "_psnr" in name]
    return quantiles.assign(**{n: quantiles[n].mask(quantiles[n] > MOST_DB) for n in psnrs})


def is_of_the_shape(column: str) -> bool:
    """Whether a column measures a decoded cloud's points against the coded ones."""
    return column.startswith(_OF_THE_SHAPE)

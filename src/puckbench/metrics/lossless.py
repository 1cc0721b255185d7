"""Detection of losslessly coded clouds: all their errors come from rounding of coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import PointCloud, bounds

if TYPE_CHECKING:
    import pandas as pd

LOSSLESS = "lossless"
"""Column of results that tells whether all errors are rounding errors."""
_ROUNDING = 2.0**-21
"""Relative tolerance of four units in the last place of single precision, for roundings at reading,
in two operations of a decoder and at writing, along three axes."""
_MOST = 1e-4
"""Largest error attributed to rounding, metres."""
_OF_THE_SHAPE = ("d1_", "d2_", "cd_", "acd_", "hausdorff_", "q99_", "range_", "view_")
"""Prefixes of columns that compare the decoded cloud with the original."""
_BEST_DB, MOST_DB = 1e9, 1e4
"""PSNR of lossless clouds in quantiles, and a limit above all PSNRs of lossy clouds, dB."""
_COUNTS = ("points_a", "points_b")


def rounding(cloud: PointCloud) -> float:
    """Return the largest error, in units of the cloud, that rounding of coordinates can cause."""
    limit = _ROUNDING * float(np.abs(bounds(cloud.xyz)).max())
    return limit if cloud.frame == "scaled" else min(limit, _MOST)


def without_rounding(errors: Mapping[str, float], limit: float) -> dict[str, float]:
    """Return the errors of a decoded cloud, set to 0 if rounding explains all of them.

    Parameters
    ----------
    errors
        Result of `puckbench.metrics.geometry.distortion`.
    limit
        Largest error that rounding can cause, from `rounding`.

    Returns
    -------
    dict
        The errors, and the entry `LOSSLESS`, which is true if they were set to 0. Numbers of points
        are kept.
    """
    is_lossless = errors["hausdorff_point"] <= limit
    kept = {k: 0.0 if is_lossless and k not in _COUNTS else v for k, v in errors.items()}
    return {**kept, LOSSLESS: is_lossless}


def lossless_rows(metrics: pd.DataFrame) -> NDArray[np.bool_]:
    """Return a mask (n,) of the rows of a results table that are lossless.

    It is taken from the column `LOSSLESS`. Where the column has no value, the errors decide.
    """
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
    """Return the table with PSNRs of lossless rows set to a finite value above all other PSNRs.

    Without this, quantiles of PSNRs could not be computed. `without_lossless` is the counterpart.
    """
    psnrs = [name for name in map(str, metrics) if "_psnr" in name and is_shape_metric(name)]
    rows = lossless_rows(metrics)
    return metrics.assign(**{name: metrics[name].mask(rows, _BEST_DB) for name in psnrs})


def without_lossless(quantiles: pd.DataFrame) -> pd.DataFrame:
    """Return a table of quantiles in which the PSNRs that stem from lossless rows are nan.

    They are recognised by their size, since `with_lossless_best` set them above all lossy PSNRs.
    """
    psnrs = [name for name in map(str, quantiles) if "_psnr" in name]
    return quantiles.assign(**{n: quantiles[n].mask(quantiles[n] > MOST_DB) for n in psnrs})


def is_shape_metric(column: str) -> bool:
    """Return whether a column of results compares the geometry of decoded cloud and original."""
    return column.startswith(_OF_THE_SHAPE)

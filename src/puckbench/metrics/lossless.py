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


def with_lossless_infinite(metrics: pd.DataFrame) -> pd.DataFrame:
    """Result rows whose PSNRs are infinite where they are lossless.

    Medians over clouds then count a lossless cloud as the best one, and do not leave it out.
    """
    psnrs = [name for name in metrics if "_psnr" in str(name) and is_of_the_shape(str(name))]
    rows = lossless_rows(metrics)
    return metrics.assign(**{name: metrics[name].mask(rows, np.inf) for name in psnrs})


def is_of_the_shape(column: str) -> bool:
    """Whether a column measures a decoded cloud's points against the coded ones."""
    return column.startswith(_OF_THE_SHAPE)

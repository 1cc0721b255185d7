"""Statistics over scenes, since clouds of one scene are not independent samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.core.seeding import generator
from puckbench.geometry.cloud import Floats

if TYPE_CHECKING:
    import pandas as pd

SCENE = "scene"
RESAMPLES = 2000
MIN_CLOUDS = 3
"""Fewest clouds or scenes for a bootstrap interval."""


def with_scenes(table: pd.DataFrame) -> pd.DataFrame:
    """Add the column ``scene``, by default the cloud's name."""
    scenes = table.get(SCENE, table["cloud"]).astype(object).fillna(table["cloud"])
    return table.assign(**{SCENE: scenes})


def means_over_seeds(
    table: pd.DataFrame, keys: Sequence[str], columns: Sequence[str]
) -> pd.DataFrame:
    """Return means of `columns` over the clouds of each scene, by `keys` and ``scene``."""
    groups = with_scenes(table).groupby([*keys, SCENE], sort=False)
    return groups[list(columns)].mean().reset_index()


def bootstrap_interval(
    values: Floats,
    resamples: int,
    rng: np.random.Generator,
    statistic: Callable[..., Any] = np.mean,
) -> tuple[float, float]:
    """Return the 95 % percentile bootstrap interval of a statistic of `values` (n,).

    Bounds are nan for n < `MIN_CLOUDS`.
    """
    if len(values) < MIN_CLOUDS:
        return np.nan, np.nan
    drawn = values[rng.integers(0, len(values), (resamples, len(values)))]
    low, high = np.quantile(statistic(drawn, axis=1), [0.025, 0.975])
    return float(low), float(high)


def median_interval(values: Floats, *names: str) -> tuple[float, float]:
    """Return the bootstrap interval, seeded by `names`, of the median of non-nan `values` (n,)."""
    rng = generator(0, "median interval", *names)
    return bootstrap_interval(values[~np.isnan(values)], RESAMPLES, rng, np.median)

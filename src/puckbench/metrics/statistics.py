"""Means over independent scenes, with intervals and verdicts.

Clouds of one scene, such as scans with other random noise, are no independent samples.
`means_over_seeds` averages them first, so that each scene counts as one sample.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from pointkit.geometry.cloud import Floats

if TYPE_CHECKING:
    import pandas as pd

SCENE = "scene"
MIN_SCENES = 6
"""An interval or a verdict needs at least this many scenes."""
CONFIDENCE = 0.95

BETTER, NOT_WORSE, WORSE, UNDECIDED = "better", "not worse", "worse", "undecided"
NO_VERDICT = "no verdict"
"""The verdict for fewer than `MIN_SCENES` scenes."""
WITHIN, BEYOND = "within the margin", "beyond the margin"
"""Verdicts on a few scenes alone: whether the greatest of their differences is below the margin."""


@dataclass(frozen=True)
class Estimate:
    """A mean over independent scenes, with a 95 % confidence interval by Student's t.

    Parameters
    ----------
    mean
        Mean over the scenes; nan if there are none.
    low, high
        Ends of the interval; nan for fewer than `MIN_SCENES` scenes.
    least, most
        Smallest and largest value of a scene.
    scenes
        Number of scenes.
    """

    mean: float
    low: float
    high: float
    least: float
    most: float
    scenes: int

    @classmethod
    def of(cls, values: Floats | Iterable[float]) -> Estimate:
        """Return the arithmetic mean of `values` (n,), one per scene, and its interval.

        Scenes with the value nan are left out.
        """
        numbers = np.asarray(list(values), np.float64)
        numbers = numbers[~np.isnan(numbers)]
        count = len(numbers)
        if count == 0:
            return cls(*5 * (math.nan,), 0)
        mean, half = float(numbers.mean()), math.nan
        if count >= MIN_SCENES:
            error = float(numbers.std(ddof=1)) / math.sqrt(count)
            half = _t_quantile(count - 1) * error
        least, most = float(numbers.min()), float(numbers.max())
        return cls(mean, mean - half, mean + half, least, most, count)

    @classmethod
    def of_ratios(cls, ratios: Floats | Iterable[float]) -> Estimate:
        """Return the geometric mean of positive `ratios` (n,), one per scene, and its interval."""
        logs = cls.of(np.log(np.asarray(list(ratios), np.float64)))
        mean, low, high, least, most = (
            math.exp(end) for end in (logs.mean, logs.low, logs.high, logs.least, logs.most)
        )
        return cls(mean, low, high, least, most, logs.scenes)

    def verdict(self, margin: float) -> str:
        """Return the verdict on a mean difference, where negative differences are better.

        Parameters
        ----------
        margin
            Largest difference, >= 0, that counts as none. It must be fixed before the measurement.

        Returns
        -------
        str
            The first of these that applies:

            * `NO_VERDICT`: there are fewer than `MIN_SCENES` scenes.
            * `BETTER`: the whole interval is below 0.
            * `NOT_WORSE`: the whole interval is below `margin`.
            * `WORSE`: the whole interval is above 0.
            * `UNDECIDED`: in all other cases.
        """
        if self.scenes < MIN_SCENES:
            return NO_VERDICT
        if self.high < 0:
            return BETTER
        if self.high < margin:
            return NOT_WORSE
        return WORSE if self.low > 0 else UNDECIDED


@cache
def _t_quantile(freedom: int) -> float:
    from scipy import stats

    return float(stats.t.ppf((1 + CONFIDENCE) / 2, freedom))


def with_scenes(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table with the column ``scene``; rows without a scene get the cloud's name."""
    scenes = table.get(SCENE, table["cloud"]).astype(object).fillna(table["cloud"])
    return table.assign(**{SCENE: scenes})


def means_over_seeds(
    table: pd.DataFrame, keys: Sequence[str], columns: Sequence[str]
) -> pd.DataFrame:
    """Return the means of columns over the clouds of each scene.

    Parameters
    ----------
    table
        Rows of clouds, with the columns `keys`, ``cloud`` and, if clouds share scenes, ``scene``.
    keys
        Columns whose values are kept apart, such as "codec" and "rate".
    columns
        Numeric columns to average.

    Returns
    -------
    pandas.DataFrame
        One row for each combination of `keys` and ``scene``.
    """
    groups = with_scenes(table).groupby([*keys, SCENE], sort=False)
    means: pd.DataFrame = groups[list(columns)].mean()
    return means.reset_index()

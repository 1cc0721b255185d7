"""Intervals and verdicts over independent scenes.

Clouds of one scene (other seeds of noise, other turns) are no independent samples: they are
averaged first (`means_over_seeds`), and a scene counts once.
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
"""Fewest scenes for an interval or a verdict; with fewer, the values themselves are shown."""
CONFIDENCE = 0.95

BETTER, NOT_WORSE, WORSE, UNDECIDED = "better", "not worse", "worse", "undecided"
NO_VERDICT = "no verdict"
"""Verdict for fewer than `MIN_SCENES` scenes."""


@dataclass(frozen=True)
class Estimate:
    """A mean over `scenes` independent scenes, with a 95 % interval by Student's t.

    `low` and `high` are nan for fewer than `MIN_SCENES` scenes; `mean` is nan for none. `least` and
    `most` are the extreme values.
    """

    mean: float
    low: float
    high: float
    least: float
    most: float
    scenes: int

    @classmethod
    def of(cls, values: Floats | Iterable[float]) -> Estimate:
        """Return the estimate of the mean of `values` (n,), one per scene; nan are left out."""
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
        """Return what the interval of differences says, where negative differences are better.

        `margin` >= 0 is the largest difference that counts as none, fixed before the measurement:
        `BETTER` if the whole interval is below 0, else `NOT_WORSE` if it is below `margin`, `WORSE`
        if it is above 0 (and not all below `margin`), otherwise `UNDECIDED`. Fewer than
        `MIN_SCENES` scenes allow `NO_VERDICT`.
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
    """Add the column ``scene``, by default the cloud's name."""
    scenes = table.get(SCENE, table["cloud"]).astype(object).fillna(table["cloud"])
    return table.assign(**{SCENE: scenes})


def means_over_seeds(
    table: pd.DataFrame, keys: Sequence[str], columns: Sequence[str]
) -> pd.DataFrame:
    """Return means of `columns` over the clouds of each scene, by `keys` and ``scene``."""
    groups = with_scenes(table).groupby([*keys, SCENE], sort=False)
    means: pd.DataFrame = groups[list(columns)].mean()
    return means.reset_index()

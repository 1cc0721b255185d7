from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.metrics.table_registry import ODOMETRY, TABLES, UNDECODED

if TYPE_CHECKING:
    import pandas as pd

DRIFT, ABSOLUTE = "drift_percent", "ate_m"
REGISTRATION = "registration_percent"
_SLACK = 0.2
"""Relative tolerance within which a result equals the mean of the undecoded drives."""
_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Reference:
    """Mean over undecoded drives, with a 95 % interval by Student's t; for one drive, the mean."""

    mean: float
    low: float
    high: float

    @classmethod
    def of(cls, values: pd.Series[Any]) -> Reference:
        from scipy import stats

        numbers = values.to_numpy(float)
        mean, count = float(numbers.mean()), len(numbers)
        if count < 2:
            return cls(mean, mean, mean)
        error = float(numbers.std(ddof=1)) / count**0.5
        half = float(stats.t.ppf((1 + _CONFIDENCE) / 2, count - 1)) * error
        return cls(mean, mean - half, mean + half)

    @property
    def most(self) -> float:
        """The largest error that counts as equal."""
        return max(self.high, (1 + _SLACK) * self.mean)

    @property
    def least(self) -> float:
        """The smallest success rate that counts as equal."""
        return min(self.low, (1 - _SLACK) * self.mean)


@TABLES.register("odometry_bits", title="Bits that odometry needs", needs=(ODOMETRY,))
def odometry_bits(drives: pd.DataFrame) -> pd.DataFrame:
    """Fewest bits per return at which a robot's task succeeds as well as on the original, undecoded
    drives.

    ``measure``: ``drift_percent`` (KISS-ICP over 10, 20 and 50 m), ``ate_m`` (absolute error) for
    drives shorter than 10 m, or ``registration_percent`` (pairs of turns 1, 2 and 5 m apart that
    GICP registers). ``undecoded``: mean of the measure over original drives, with a 95 % interval
    by Student's t (``low``, ``high``); these drives have times of firings if the codec keeps them
    (``has_times``). ``bits``, ``rate``: the lowest rate from which on all rates are no worse than
    the interval, or at most a fifth worse than the mean; empty if there is none.
    ``lost_turns``: sum over drives at the codec's lowest rate.
    """
    import pandas as pd

    rows = [row for dataset in drives["dataset"].unique() for row in _of_dataset(drives, dataset)]
    if not rows:
        raise InputError("drives table: no codec's results and those of the undecoded drives")
    return pd.DataFrame(rows)


def _of_dataset(drives: pd.DataFrame, dataset: str) -> Iterator[dict[str, Any]]:
    rows = with_registration(drives[drives["dataset"] == dataset])
    for measure in measures(rows):
        for codec in rows["codec"].unique():
            if codec != UNDECODED:
                curve = mean_curve(rows[rows["codec"] == codec], measure)
                reference = reference_of(rows, measure, bool(curve["has_times"].all()))
                is_as_good = (
                    curve[measure] >= reference.least
                    if measure == REGISTRATION
                    else curve[measure] <= reference.most
                )
                kept = np.flatnonzero(np.logical_and.accumulate(is_as_good[::-1])[::-1])
                first = curve.iloc[kept[0]] if len(kept) else None
                yield {
                    "dataset": dataset,
                    "measure": measure,
                    "codec": codec,
                    "bits": np.nan if first is None else float(first["bpp"]),
                    "rate": "" if first is None else str(first["rate"]),
                    "value": np.nan if first is None else float(first[measure]),
                    "undecoded": reference.mean,
                    "low": reference.low,
                    "high": reference.high,
                    "has_times": bool(curve["has_times"].all()),
                    "lost_turns": int(curve["lost_turns"].iloc[0]),
                    "drives": rows["cloud"].nunique(),
                }


def measures(rows: pd.DataFrame) -> list[str]:
    offered = [DRIFT if DRIFT in rows and rows[DRIFT].notna().all() else ABSOLUTE, REGISTRATION]
    return [name for name in offered if name in rows and rows[name].notna().all()]


def with_registration(rows: pd.DataFrame) -> pd.DataFrame:
    """Add the success rate of registration, averaged over all distances between two turns."""
    apart = rows.filter(regex=r"^registration_\d+m_percent$").dropna(axis=1, how="all")
    return rows.assign(**{REGISTRATION: apart.mean(axis=1)}) if len(apart.columns) else rows


def reference_of(rows: pd.DataFrame, measure: str, has_times: bool) -> Reference:
    """Return the result on undecoded drives with or without times of firings."""
    undecoded = rows[rows["codec"] == UNDECODED]
    alike = undecoded[undecoded["has_times"] == has_times]
    if alike.empty:
        raise InputError("drives table: no result of the undecoded drives")
    return Reference.of(alike[measure])


def mean_curve(rows: pd.DataFrame, measure: str) -> pd.DataFrame:
    """Return a codec's rates by increasing bits, with means of bits and `measure` over drives."""
    mean = rows.groupby("rate", as_index=False).agg(
        {"bpp": "mean", measure: "mean", "has_times": "all", "lost_turns": "sum"}
    )
    return mean.sort_values("bpp", ignore_index=True)

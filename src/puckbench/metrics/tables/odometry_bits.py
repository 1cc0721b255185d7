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
"""A result counts as equal up to this fraction above the mean of the undecoded drives."""
_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Reference:
    """Mean over undecoded drives, with its 95 % interval (Student's t; equal to it for one)."""

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
        """The smallest success that counts as equal."""
        return min(self.low, (1 - _SLACK) * self.mean)


@TABLES.register("odometry_bits", title="Bits that odometry needs", needs=(ODOMETRY,))
def odometry_bits(drives: pd.DataFrame) -> pd.DataFrame:
    """The fewest bits per return at which a robot's task is as good as on the undecoded drives.

    ``measure``: ``drift_percent`` (KISS-ICP over 10, 20 and 50 m), ``ate_m`` for drives too short
    for it, or ``registration_percent`` (pairs 1, 2 and 5 m apart that GICP registers).
    ``undecoded``: its mean over the drives, with a 95 % interval by Student's t (``low``,
    ``high``), with times of firings if the codec keeps them (``has_times``), otherwise without.
    ``bits`` and ``rate``: the lowest rate that is, as all higher ones, inside the interval or worse
    than the mean by at most a fifth; empty if the highest is not. ``lost_turns``: over all drives,
    at the codec's lowest rate.
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
    """Add the mean success over all distances of pairs."""
    apart = rows.filter(regex=r"^registration_\d+m_percent$").dropna(axis=1, how="all")
    return rows.assign(**{REGISTRATION: apart.mean(axis=1)}) if len(apart.columns) else rows


def reference_of(rows: pd.DataFrame, measure: str, has_times: bool) -> Reference:
    """Return the result on undecoded drives, with or without times."""
    undecoded = rows[rows["codec"] == UNDECODED]
    alike = undecoded[undecoded["has_times"] == has_times]
    if alike.empty:
        raise InputError("drives table: no result of the undecoded drives")
    return Reference.of(alike[measure])


def mean_curve(rows: pd.DataFrame, measure: str) -> pd.DataFrame:
    mean = rows.groupby("rate", as_index=False).agg(
        {"bpp": "mean", measure: "mean", "has_times": "all", "lost_turns": "sum"}
    )
    return mean.sort_values("bpp", ignore_index=True)

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.core.errors import InputError, among
from puckbench.core.seeding import generator
from puckbench.geometry.cloud import Floats
from puckbench.metrics.bjontegaard import (
    COMPARED,
    LITTLE_OVERLAP,
    NO_COMMON_RANGE,
    TOO_FEW_POINTS,
    RateDistortionCurve,
    bjontegaard_delta,
    rate_distortion_curve,
)
from puckbench.metrics.lossless import LOSSLESS, is_shape_metric, lossless_rows
from puckbench.metrics.peaks import check_peaks
from puckbench.metrics.scenes import RESAMPLES, SCENE, bootstrap_interval, means_over_seeds
from puckbench.metrics.table_registry import SEVERAL_CODECS, TABLES

if TYPE_CHECKING:
    import pandas as pd

METRICS = ("d1_psnr", "d2_psnr")
_GROUP = ["dataset", "metric", "codec"]


@TABLES.register("bd_rate_clouds", title="Bjontegaard deltas per cloud", needs=(SEVERAL_CODECS,))
def bd_rate_clouds(
    metrics: pd.DataFrame, anchor: str, qualities: Sequence[str] = METRICS
) -> pd.DataFrame:
    """Bjontegaard deltas of every codec against the anchor on each cloud.

    There is no value if the curves have less than half of the shorter curve's range in common;
    ``bd_rate_status`` gives the reason. Lossless rates are left out.

    Parameters
    ----------
    qualities
        Columns of the results, in dB if they end in ``_psnr``; else squared distances d, converted
        to the quality -10 log10 d.

    Returns
    -------
    pd.DataFrame
        ``shared_range`` is `BjontegaardDelta.overlap`; ``points``, ``dropped`` and ``lossless``
        count points of a curve, dominated points and lossless rates.
    """
    import pandas as pd

    _check(metrics, anchor, qualities)
    rows: list[dict[str, Any]] = []
    for metric in qualities:
        rows_with_quality = _with_quality(metrics, metric)
        for (dataset, cloud), part in rows_with_quality.groupby(["dataset", "cloud"], sort=False):
            names = {"dataset": dataset, "metric": metric, "anchor": anchor, "cloud": cloud}
            names |= {SCENE: part[SCENE].iloc[0]} if SCENE in part else {}
            rows += [{**names, **row} for row in _against(part, anchor)]
    if not rows:
        raise InputError(f"metrics table: no codec but the anchor {anchor}")
    leading = [*_GROUP, "anchor", "cloud"]
    table = pd.DataFrame(rows)
    return table[leading + [name for name in table if name not in leading]]


@TABLES.register("bd_rate", title="Bjontegaard deltas per data set", needs=(SEVERAL_CODECS,))
def bd_rate(
    metrics: pd.DataFrame,
    anchor: str,
    qualities: Sequence[str] = METRICS,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> pd.DataFrame:
    """Bjontegaard deltas of every codec against the anchor, by data set and metric: mean change of
    the rate at equal quality in percent (negative: fewer bits), and of the quality at equal rate in
    dB, with 95 % bootstrap intervals.

    Deltas of each cloud, by PCHIP interpolation of the log rate, are averaged over the seeds of a
    scene, then over scenes, which the bootstrap resamples. Clouds whose curves have less than half
    of the shorter range in common, and lossless rates, are counted but not averaged.

    Returns
    -------
    pd.DataFrame
        ``bd_rate_percent`` comes from the mean log rate ratio of the ``compared`` clouds, so that
        swapping codec and anchor inverts the ratio; ``..._arithmetic`` is the mean of percentages.
        ``shared_range`` is a median; ``dropped`` and ``lossless`` are sums.
    """
    import pandas as pd

    clouds = bd_rate_clouds(metrics, anchor, qualities)
    rows = []
    for names, part in clouds.groupby(_GROUP, sort=False):
        label = [str(name) for name in names]
        rng = generator(seed, "bd_rate", *label)
        values = {**dict(zip(_GROUP, label, strict=True)), "anchor": anchor}
        rows.append({**values, **_means(part, resamples, rng), **_counts(part)})
    return pd.DataFrame(rows)


def log_ratios(metrics: pd.DataFrame, anchor: str, tested: str, quality: str) -> Floats:
    """Return the mean ln(rate / anchor rate) at equal quality of each scene with a value, (n,)."""
    both = metrics[metrics["codec"].isin([anchor, tested])]
    clouds = bd_rate_clouds(both, anchor, [quality])
    return means_over_seeds(clouds, (), ["log_ratio"])["log_ratio"].dropna().to_numpy(float)


def is_below_zero(differences: Floats, seed: int = 0) -> bool:
    """Return whether the mean of paired differences (n,) is significantly negative.

    The 95 % interval must be negative or, with too few values for an interval, every value.
    """
    rng = generator(seed, "paired differences")
    high = bootstrap_interval(differences, RESAMPLES, rng)[1]
    if np.isnan(high):
        high = max(differences, default=np.nan)
    return bool(high < 0)


def _check(metrics: pd.DataFrame, anchor: str, qualities: Sequence[str]) -> None:
    columns = [] if lossless_rows(metrics).all() else qualities
    for name in ["dataset", "cloud", "codec", "rate", "bpp", *columns]:
        if name not in metrics:
            raise InputError(f"metrics table: no column {name!r}")
    if anchor not in set(metrics["codec"]):
        suggestion = among(anchor, sorted(set(metrics["codec"])))
        raise InputError(f"BD-rate: no results of the anchor {anchor!r}{suggestion}")
    not_positive = metrics[metrics["bpp"] <= 0]
    if len(not_positive):
        codec, *names = map(str, not_positive[["codec", "dataset", "cloud", "rate"]].iloc[0])
        where = f"{codec} of {'/'.join(names)}"
        raise InputError(f"metrics table: column 'bpp' must be positive, but is not for {where}")
    check_peaks(metrics, qualities)


def _with_quality(metrics: pd.DataFrame, column: str) -> pd.DataFrame:
    lossless = lossless_rows(metrics) & is_shape_metric(column)
    quality = np.where(lossless, np.nan, _quality(metrics, column))
    rows = metrics.assign(**{LOSSLESS: lossless, "quality": quality})
    is_usable = rows["quality"].notna() | rows[LOSSLESS]
    has_gaps = (~is_usable).groupby(rows["dataset"]).transform("any")
    has_quality = rows["quality"].notna().groupby(rows["dataset"]).transform("any")
    return rows[is_usable & (has_quality | ~has_gaps)]


def _quality(metrics: pd.DataFrame, column: str) -> Floats:
    if column not in metrics:  # all rows are lossless
        return np.full(len(metrics), np.nan)
    values = metrics[column].to_numpy(dtype=float)
    if column.endswith("_psnr"):
        return values
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(values > 0, -10 * np.log10(values), np.nan)


def _against(part: pd.DataFrame, anchor: str) -> list[dict[str, Any]]:
    curves = {str(codec): _curve(rows) for codec, rows in part.groupby("codec", sort=False)}
    if anchor not in curves:
        return []
    base, exact = curves.pop(anchor)
    return [
        {"codec": codec, **_compared(base, tested), LOSSLESS: lossless, f"anchor_{LOSSLESS}": exact}
        for codec, (tested, lossless) in curves.items()
    ]


def _curve(rows: pd.DataFrame) -> tuple[RateDistortionCurve, int]:
    result = rate_distortion_curve(rows["bpp"].to_numpy(float), rows["quality"].to_numpy(float))
    return result, int(rows[LOSSLESS].sum())


def _compared(base: RateDistortionCurve, tested: RateDistortionCurve) -> dict[str, Any]:
    difference = bjontegaard_delta(base, tested)
    return {
        "bd_rate_percent": _number(difference.rate_percent),
        "bd_rate_status": difference.rate_status,
        "bd_quality_db": _number(difference.quality_db),
        "bd_quality_status": difference.quality_status,
        "shared_range": difference.overlap,
        "points": len(tested.quality),
        "anchor_points": len(base.quality),
        "dropped": tested.dropped,
        "anchor_dropped": base.dropped,
        "log_ratio": _number(difference.log_ratio),
    }


def _number(value: float | None) -> float:
    return np.nan if value is None else value


def _counts(part: pd.DataFrame) -> dict[str, Any]:
    status = part["bd_rate_status"]
    return {
        "clouds": len(part),
        "compared": int((status == COMPARED).sum()),
        "no_common_range": int((status == NO_COMMON_RANGE).sum()),
        "little_overlap": int((status == LITTLE_OVERLAP).sum()),
        "too_few_points": int((status == TOO_FEW_POINTS).sum()),
        "quality_compared": int((part["bd_quality_status"] == COMPARED).sum()),
        "shared_range": float(part["shared_range"].median()),
        "dropped": int(part["dropped"].sum()),
        "anchor_dropped": int(part["anchor_dropped"].sum()),
        LOSSLESS: int(part[LOSSLESS].sum()),
        f"anchor_{LOSSLESS}": int(part[f"anchor_{LOSSLESS}"].sum()),
    }


def _means(part: pd.DataFrame, resamples: int, rng: np.random.Generator) -> dict[str, float]:
    scenes = means_over_seeds(part, (), ("bd_rate_percent", "log_ratio", "bd_quality_db"))
    percent = scenes["bd_rate_percent"].dropna()
    logs = scenes["log_ratio"].dropna().to_numpy()
    low, high = bootstrap_interval(logs, resamples, rng)
    gains = scenes["bd_quality_db"].dropna().to_numpy()
    gain_low, gain_high = bootstrap_interval(gains, resamples, rng)
    return {
        "bd_rate_percent": _percent(_mean(logs)),
        "bd_rate_percent_low": _percent(low),
        "bd_rate_percent_high": _percent(high),
        "bd_rate_percent_arithmetic": _mean(percent.to_numpy()),
        "bd_rate_percent_median": float(percent.median()),
        "bd_rate_percent_q25": float(percent.quantile(0.25)),
        "bd_rate_percent_q75": float(percent.quantile(0.75)),
        "bd_rate_percent_least": float(percent.min()),
        "bd_rate_percent_most": float(percent.max()),
        "bd_quality_db": _mean(gains),
        "bd_quality_db_low": gain_low,
        "bd_quality_db_high": gain_high,
    }


def _mean(values: Floats) -> float:
    return float(values.mean()) if len(values) else np.nan


def _percent(log_ratio: float) -> float:
    return 100 * float(np.expm1(log_ratio))

"""Tables of Bjontegaard deltas against an anchor codec: per cloud, and per data set.

A delta is taken cloud by cloud, never between medians over clouds, which belong to no cloud.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.core.models import among
from puckbench.core.seeding import generator
from puckbench.geometry.cloud import Floats
from puckbench.metrics.bjontegaard import (
    COMPARED,
    LITTLE_OVERLAP,
    NO_COMMON_RANGE,
    TOO_FEW_POINTS,
    Curve,
    curve,
    delta,
)
from puckbench.metrics.lossless import LOSSLESS, is_of_the_shape, lossless_rows
from puckbench.metrics.peaks import check_peaks
from puckbench.metrics.table_registry import SEVERAL_CODECS, TABLES

if TYPE_CHECKING:
    import pandas as pd

METRICS = ("d1_psnr", "d2_psnr")
RESAMPLES = 2000
LEAST_CLOUDS = 3
"""With fewer clouds there is nothing to resample."""
_GROUP = ["dataset", "metric", "codec"]


@TABLES.register("bd_rate_clouds", title="Bjontegaard deltas per cloud", needs=(SEVERAL_CODECS,))
def bd_rate_clouds(
    metrics: pd.DataFrame, anchor: str, qualities: Sequence[str] = METRICS
) -> pd.DataFrame:
    """Bjontegaard deltas of every codec against the anchor on each cloud.

    The status says whether the two curves have at least half of the shorter one's range in common:
    where they have not, there is no value. Lossless rates, whose errors are those of the rounding
    of numbers, are no part of a curve.

    Parameters
    ----------
    metrics
        All results of a run.
    anchor
        The codec that the others are compared with.
    qualities
        Columns of the results; one that ends in ``_psnr`` is a quality in dB, any other a squared
        distortion d, whose quality is -10 log10 d.

    Returns
    -------
    pd.DataFrame
        One row per data set, metric, codec and cloud: ``dataset``, ``metric``, ``codec``,
        ``anchor``, ``cloud``, ``bd_rate_percent``, ``bd_rate_status``, ``bd_quality_db``,
        ``bd_quality_status`` (as of `puckbench.metrics.bjontegaard.Delta`), ``shared_range`` (of
        the shorter curve's qualities), ``points`` and ``anchor_points`` used, ``dropped`` and
        ``anchor_dropped``, ``lossless`` and ``anchor_lossless`` rates left out, ``log_ratio``.

    Raises
    ------
    InputError
        The anchor or a column is not in the table, there is no other codec, or PSNRs of a cloud
        have several peaks.
    """
    import pandas as pd

    _check(metrics, anchor, qualities)
    rows: list[dict[str, Any]] = []
    for metric in qualities:
        known = _with_quality(metrics, metric)
        for (dataset, cloud), part in known.groupby(["dataset", "cloud"], sort=False):
            names = {"dataset": dataset, "metric": metric, "anchor": anchor, "cloud": cloud}
            rows += [{**names, **row} for row in _against(part, anchor)]
    if not rows:
        raise InputError(f"metrics table: no codec beside the anchor {anchor} on any cloud")
    first = [*_GROUP, "anchor", "cloud"]
    table = pd.DataFrame(rows)
    return table[first + [name for name in table if name not in first]]


@TABLES.register("bd_rate", title="Bjontegaard deltas per data set", needs=(SEVERAL_CODECS,))
def bd_rate(
    metrics: pd.DataFrame,
    anchor: str,
    qualities: Sequence[str] = METRICS,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> pd.DataFrame:
    """Bjontegaard deltas of every codec against the anchor, per data set and measure of quality.

    The mean change of the rate at equal quality in percent (negative: fewer bits), and of the
    quality at equal rate in dB, with 95 % bootstrap intervals over the clouds. Each cloud's curves
    are interpolated with PCHIP in the logarithm of the rate; clouds whose curves share less than
    half of the shorter one's range are counted, and count in no mean. Lossless rates are left out
    of the curves, and counted.

    Parameters
    ----------
    metrics, anchor, qualities
        As of `bd_rate_clouds`.
    resamples, seed
        Draws of the bootstrap, and their seed.

    Returns
    -------
    pd.DataFrame
        One row per data set, metric and codec. ``clouds`` are those that both codecs have;
        ``compared`` of them have half of the shorter curve's range of quality in common;
        ``no_common_range``, ``little_overlap`` and ``too_few_points`` have not.

        * ``bd_rate_percent``: from the mean of the logarithms of the clouds' rate ratios, so that
          the exchange of codec and anchor inverts it; ``..._arithmetic``: mean of the percentages,
          which others report; ``..._median``, ``..._q25``, ``..._q75``, ``..._least``,
          ``..._most``: of the clouds.
        * ``bd_quality_db``: mean over ``quality_compared`` clouds with a common range of rates.
        * ``..._low``, ``..._high``: 95 % interval of these means, percentile bootstrap over clouds;
          none below three clouds, and too narrow with few.
        * ``shared_range``: median; ``dropped``, ``anchor_dropped``: points of curves left out;
          ``lossless``, ``anchor_lossless``: lossless rates left out, over all clouds.
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
    """Mean of ln(rate / anchor's rate) at equal quality on each cloud that has a delta, (n,)."""
    both = metrics[metrics["codec"].isin([anchor, tested])]
    return bd_rate_clouds(both, anchor, [quality])["log_ratio"].dropna().to_numpy(float)


def is_below_zero(differences: Floats, seed: int = 0) -> bool:
    """Whether paired differences (n,) are negative beyond chance, by the interval of their mean.

    Of fewer clouds than a bootstrap needs all must be negative; without any nothing can be told.
    """
    rng = generator(seed, "paired differences")
    high = bootstrap_interval(differences, RESAMPLES, rng)[1]
    if np.isnan(high):
        high = max(differences, default=np.nan)
    return bool(high < 0)


def _check(metrics: pd.DataFrame, anchor: str, qualities: Sequence[str]) -> None:
    measured = [] if lossless_rows(metrics).all() else qualities
    for name in ["dataset", "cloud", "codec", "rate", "bpp", *measured]:
        if name not in metrics:
            raise InputError(f"metrics table: no column {name!r}")
    if anchor not in set(metrics["codec"]):
        known = among(anchor, sorted(set(metrics["codec"])))
        raise InputError(f"BD-rate: no results of the anchor {anchor!r}{known}")
    empty = metrics[metrics["bpp"] <= 0]
    if len(empty):
        codec, *place = map(str, empty[["codec", "dataset", "cloud", "rate"]].iloc[0])
        where = f"{codec} of {'/'.join(place)}"
        raise InputError(f"metrics table: column 'bpp' has a value that is not positive: {where}")
    check_peaks(metrics, qualities)


def _with_quality(metrics: pd.DataFrame, column: str) -> pd.DataFrame:
    """The rows that have a quality in dB, and the lossless rows of data sets that have it."""
    lossless = lossless_rows(metrics) & is_of_the_shape(column)
    quality = np.where(lossless, np.nan, _quality(metrics, column))
    found = metrics.assign(**{LOSSLESS: lossless, "quality": quality})
    is_known = found["quality"].notna() | found[LOSSLESS]
    lacks = (~is_known).groupby(found["dataset"]).transform("any")
    has = found["quality"].notna().groupby(found["dataset"]).transform("any")
    return found[is_known & (has | ~lacks)]


def _quality(metrics: pd.DataFrame, column: str) -> Floats:
    if column not in metrics:  # all rows are lossless
        return np.full(len(metrics), np.nan)
    values = metrics[column].to_numpy(dtype=float)
    if column.endswith("_psnr"):
        return values
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(values > 0, -10 * np.log10(values), np.nan)


def _against(part: pd.DataFrame, anchor: str) -> list[dict[str, Any]]:
    """A row for each other codec of one cloud; none where the anchor has no result there."""
    curves = {str(codec): _curve(rows) for codec, rows in part.groupby("codec", sort=False)}
    if anchor not in curves:
        return []
    base, exact = curves.pop(anchor)
    return [
        {"codec": codec, **_compared(base, tested), LOSSLESS: lossless, f"anchor_{LOSSLESS}": exact}
        for codec, (tested, lossless) in curves.items()
    ]


def _curve(rows: pd.DataFrame) -> tuple[Curve, int]:
    """The curve of a codec on a cloud, and the number of its lossless rates."""
    found = curve(rows["bpp"].to_numpy(float), rows["quality"].to_numpy(float))
    return found, int(rows[LOSSLESS].sum())


def _compared(base: Curve, tested: Curve) -> dict[str, Any]:
    found = delta(base, tested)
    return {
        "bd_rate_percent": _number(found.rate_percent),
        "bd_rate_status": found.rate_status,
        "bd_quality_db": _number(found.quality_db),
        "bd_quality_status": found.quality_status,
        "shared_range": found.shared,
        "points": len(tested.quality),
        "anchor_points": len(base.quality),
        "dropped": tested.dropped,
        "anchor_dropped": base.dropped,
        "log_ratio": _number(found.log_ratio),
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
    percent = part["bd_rate_percent"].dropna()
    logs = part["log_ratio"].dropna().to_numpy()
    low, high = bootstrap_interval(logs, resamples, rng)
    gains = part["bd_quality_db"].dropna().to_numpy()
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


def bootstrap_interval(
    values: Floats, resamples: int, rng: np.random.Generator
) -> tuple[float, float]:
    """95 % percentile bootstrap interval of the mean of `values` (n,); nan below three values."""
    if len(values) < LEAST_CLOUDS:
        return np.nan, np.nan
    drawn = rng.integers(0, len(values), (resamples, len(values)))
    low, high = np.quantile(values[drawn].mean(axis=1), [0.025, 0.975])
    return float(low), float(high)

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
from puckbench.metrics.bjontegaard import COMPARED, NO_COMMON_RANGE, TOO_FEW_POINTS, curve, delta
from puckbench.metrics.registry import SEVERAL_CODECS, TABLES

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

    The status says whether the two curves have a common range: where they have none, there is no
    value.

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
        the anchor's qualities), ``points`` and ``anchor_points`` used, ``dropped`` and
        ``anchor_dropped``, ``log_ratio``.

    Raises
    ------
    InputError
        The anchor or a column is not in the table, or there is no other codec.
    """
    import pandas as pd

    _check(metrics, anchor, qualities)
    rows: list[dict[str, Any]] = []
    for metric in qualities:
        known = metrics.assign(quality=_quality(metrics, metric)).dropna(subset=["quality"])
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
    are interpolated with PCHIP in the logarithm of the rate; clouds whose curves have no common
    range are counted, and count in no mean.

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
        ``compared`` of them have a common range of quality, ``no_common_range`` and
        ``too_few_points`` have not.

        * ``bd_rate_percent``: from the mean of the logarithms of the clouds' rate ratios, so that
          the exchange of codec and anchor inverts it; ``..._arithmetic``: mean of the percentages,
          which others report; ``..._median``, ``..._q25``, ``..._q75``: of the clouds.
        * ``bd_quality_db``: mean over ``quality_compared`` clouds with a common range of rates.
        * ``..._low``, ``..._high``: 95 % interval of these means, percentile bootstrap over clouds;
          none below three clouds, and too narrow with few.
        * ``shared_range``: median; ``dropped``, ``anchor_dropped``: points of curves left out.
    """
    import pandas as pd

    clouds = bd_rate_clouds(metrics, anchor, qualities)
    rows = []
    for names, part in clouds.groupby(_GROUP, sort=False):
        label = [str(name) for name in names]
        rng = generator(seed, "bd_rate", *label)
        values = {**dict(zip(_GROUP, label, strict=True)), "anchor": anchor}
        rows.append({**values, **_counts(part), **_means(part, resamples, rng)})
    return pd.DataFrame(rows)


def _check(metrics: pd.DataFrame, anchor: str, qualities: Sequence[str]) -> None:
    needed = ["dataset", "cloud", "codec", "rate", "bpp", *qualities]
    for name in needed:
        if name not in metrics:
            raise InputError(f"metrics table: no column {name!r}")
    if anchor not in set(metrics["codec"]):
        known = among(anchor, sorted(set(metrics["codec"])))
        raise InputError(f"BD-rate: no results of the anchor {anchor!r}{known}")
    if (metrics["bpp"] <= 0).any():
        raise InputError("metrics table: column 'bpp' has a value that is not positive")


def _quality(metrics: pd.DataFrame, column: str) -> Floats:
    values = metrics[column].to_numpy(dtype=float)
    if column.endswith("_psnr"):
        return values
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(values > 0, -10 * np.log10(values), np.nan)


def _against(part: pd.DataFrame, anchor: str) -> list[dict[str, Any]]:
    """A row for each other codec of one cloud; none where the anchor has no result there."""
    curves = {
        str(codec): curve(rows["bpp"].to_numpy(float), rows["quality"].to_numpy(float))
        for codec, rows in part.groupby("codec", sort=False)
    }
    if anchor not in curves:
        return []
    base = curves.pop(anchor)
    rows = []
    for codec, tested in curves.items():
        found = delta(base, tested)
        rows.append(
            {
                "codec": codec,
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
        )
    return rows


def _number(value: float | None) -> float:
    return np.nan if value is None else value


def _counts(part: pd.DataFrame) -> dict[str, Any]:
    status = part["bd_rate_status"]
    return {
        "clouds": len(part),
        "compared": int((status == COMPARED).sum()),
        "no_common_range": int((status == NO_COMMON_RANGE).sum()),
        "too_few_points": int((status == TOO_FEW_POINTS).sum()),
        "quality_compared": int((part["bd_quality_status"] == COMPARED).sum()),
        "shared_range": float(part["shared_range"].median()),
        "dropped": int(part["dropped"].sum()),
        "anchor_dropped": int(part["anchor_dropped"].sum()),
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

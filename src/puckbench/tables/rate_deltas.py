from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.errors import InputError, among
from pointkit.geometry.cloud import Floats
from puckbench.geometry.attributes import COLOUR, REFLECTANCE
from puckbench.metrics.bjontegaard import (
    COMPARED,
    LITTLE_OVERLAP,
    MIN_POINTS,
    NO_COMMON_RANGE,
    TOO_FEW_POINTS,
    RateDistortionCurve,
    bjontegaard_delta,
    rate_distortion_curve,
)
from puckbench.metrics.lossless import LOSSLESS, is_shape_metric, lossless_rows
from puckbench.metrics.peaks import check_peaks
from puckbench.metrics.statistics import SCENE, Estimate, means_over_seeds
from puckbench.results.columns import GRID, HIGHER, LOWER, Column, column_named
from puckbench.tables.registry import SEVERAL_CODECS, TABLES

if TYPE_CHECKING:
    import pandas as pd

METRICS = ("d1_psnr", "d2_psnr")
MARGIN_PERCENT = 5.0
"""Default of the largest increase of the bits, in percent, that counts as none."""
_GROUP = ["dataset", "metric", "codec"]
_SHOWN = (
    *("dataset", "metric", "codec", "anchor"),
    *("bd_rate_percent", "bd_quality_db", "verdict", "scenes"),
)
_OF_CURVE = ("points", "pooled", LOSSLESS)
"""Columns that describe the codec's curve; ``anchor_...`` describes the anchor's."""
_LENGTHS = ("m", "mm", GRID)
"""Units that mark a column of lengths, whose quality is -20 log10 of the value."""
_COMPARED = {
    "geometry": (
        *("d1_", "d2_", "cd_", "acd_", "hausdorff_", "q99_", "range_"),
        *("truth_", "clean_"),
    ),
    COLOUR: ("y_", "u_", "v_", "colour_", "luminance_"),
    REFLECTANCE: ("reflectance_",),
}
"""What metrics compare, as in the names of the columns of bits, and how their names begin."""
_STATUS = {
    "no_common_range": NO_COMMON_RANGE,
    "little_overlap": LITTLE_OVERLAP,
    "too_few_points": TOO_FEW_POINTS,
}
"""Columns that count clouds without a delta, and their status."""


def _columns() -> Iterator[Column]:
    """Yield the columns of ``bd_rate``, ``bd_rate_pairs`` and ``bd_rate_clouds``."""
    too_little = "the curves have too little in common (columns of counts)"
    yield Column("bd_rate_percent", "BD-rate", "%", LOWER, missing=too_little, decimals=1)
    yield Column("bd_quality_db", "BD-PSNR", "dB", HIGHER, missing=too_little, decimals=2)
    for name, words in (("log_ratio", "Log ratio of rates"), ("shared_range", "Shared range")):
        yield Column(name, words, missing=too_little, bookkeeping=True)
    for name, words in (
        ("bd_rate_status", "Status of the BD-rate"),
        ("bd_quality_status", "Status of the BD-PSNR"),
        ("compared", "Compared"),
        ("quality_compared", "Quality compared"),
        ("no_common_range", "No common range"),
        ("little_overlap", "Little overlap"),
        ("too_few_points", "Too few points"),
        ("bits_counted", "Bits that count"),
        ("pooled", "Pooled"),
        ("anchor_points", "Anchor points"),
        ("anchor_pooled", "Anchor pooled"),
        ("anchor_lossless", "Anchor lossless"),
    ):
        yield Column(name, words, bookkeeping=True)


@TABLES.register(
    "bd_rate_clouds",
    title="Bjontegaard deltas per cloud",
    needs=(SEVERAL_CODECS,),
    columns=_columns(),
    shown=("dataset", "cloud", "metric", "codec", "anchor", "bd_rate_percent", "bd_quality_db"),
)
def bd_rate_clouds(
    metrics: pd.DataFrame, anchor: str, qualities: Sequence[str] = METRICS
) -> pd.DataFrame:
    """The table shows the Bjontegaard deltas of every codec against the anchor on each cloud.

    There is no value if a curve has fewer than four points, or if the curves have less than half of
    the shorter curve's range in common. ``bd_rate_status`` gives the reason. Lossless rates are
    left out. For metrics of positions, colours or reflectances, only the bits of these count if all
    codecs tell them.

    Parameters
    ----------
    metrics
        Results of a run, a row for each cloud, codec and rate.
    anchor
        Name of the codec with which the others are compared.
    qualities
        Columns of the results that measure quality, by their units: dB are kept, a length d is
        converted to -20 log10 d, and any other column, a squared distance d, to -10 log10 d.

    Returns
    -------
    pd.DataFrame
        ``bits_counted`` is the column of the results with the bits that count: those of the
        positions or of the attribute that the metric compares, or all if a codec does not tell
        them. ``shared_range`` is `BjontegaardDelta.overlap`. ``points``, ``pooled`` and
        ``lossless`` count the points of a curve, the points pooled by `rate_distortion_curve`, and
        the lossless rates.
    """
    import pandas as pd

    _check(metrics, anchor, qualities)
    rows = [
        curves.delta(codec, anchor)
        for curves in _curves(metrics, qualities)
        for codec in curves.codecs
        if anchor in curves.codecs and codec != anchor
    ]
    if not rows:
        raise InputError(f"metrics table: no codec but the anchor {anchor}")
    table = pd.DataFrame(rows)
    table["bd_rate_percent"] = 100 * np.expm1(table["log_ratio"])
    leading = [*_GROUP, "anchor", "cloud", "bd_rate_percent"]
    return table[leading + [name for name in table if name not in leading]]


@TABLES.register(
    "bd_rate",
    title="Bjontegaard deltas per data set",
    needs=(SEVERAL_CODECS,),
    shown=_SHOWN,
)
def bd_rate(
    metrics: pd.DataFrame,
    anchor: str,
    qualities: Sequence[str] = METRICS,
    margin_percent: float = MARGIN_PERCENT,
) -> pd.DataFrame:
    """The table shows the Bjontegaard deltas of codecs against the anchor, by data set and metric.

    ``bd_rate_percent`` is the mean change of the rate at equal quality in percent (negative: fewer
    bits). ``bd_quality_db`` is the mean change of the quality at equal rate in dB. Deltas of each
    cloud, by PCHIP interpolation of the log rate, are averaged over the seeds of a scene, then over
    scenes.

    From six scenes on, ``low`` and ``high`` are 95 % intervals by Student's t of the log ratio of
    the rates, and ``verdict`` is "better", "not worse" (by more than the margin), "worse", or
    "undecided". For fewer scenes see the extremes (``least``, ``most``). Clouds whose curves have
    less than half of the shorter range in common or fewer than four points, and lossless rates, are
    counted but not averaged.

    Parameters
    ----------
    metrics, anchor, qualities
        As in `bd_rate_clouds`.
    margin_percent
        Largest increase of the bits, in percent, that counts as none.

    Returns
    -------
    pd.DataFrame
        ``bd_rate_percent`` comes from the mean log rate ratio of the ``scenes`` with a delta, so
        that swapping codec and anchor inverts the ratio. ``shared_range`` is a median. ``pooled``
        and ``lossless`` are sums over clouds.
    """
    return _per_data_set(bd_rate_clouds(metrics, anchor, qualities), margin_percent)


@TABLES.register(
    "bd_rate_pairs",
    title="Every codec against every other",
    needs=(SEVERAL_CODECS,),
    shown=_SHOWN,
)
def bd_rate_pairs(
    metrics: pd.DataFrame,
    anchor: str,
    qualities: Sequence[str] = METRICS,
    margin_percent: float = MARGIN_PERCENT,
) -> pd.DataFrame:
    """The table shows the Bjontegaard deltas between all pairs of codecs, as in ``bd_rate``.

    They are the codec's rate relative to that of the codec in the column ``anchor``. Rankings are
    made from these.
    """
    import pandas as pd

    _check(metrics, anchor, qualities)
    rows = [
        row
        for curves in _curves(metrics, qualities)
        for codec, other in combinations(curves.codecs, 2)
        for row in _both_ways(curves.delta(codec, other))
    ]
    if not rows:
        raise InputError(f"metrics table: no codec but the anchor {anchor}")
    return _per_data_set(pd.DataFrame(rows), margin_percent)


def bd_rate_of_curves(anchor: pd.DataFrame, tested: pd.DataFrame, quality: str) -> float:
    """Return the BD-rate of one curve against another in percent, as in ``bd_rate_clouds``.

    Parameters
    ----------
    anchor, tested
        Results of two codecs on one cloud, a row for each rate.
    quality
        Column that measures quality (`qualities` of `bd_rate_clouds`).

    Raises
    ------
    InputError
        A column is missing, a rate is not positive, the PSNRs have different peaks, or the curves
        have no delta.
    """
    import pandas as pd

    one_cloud = {"dataset": "", "cloud": ""}
    curves = {"anchor": anchor, "tested": tested}
    rows = pd.concat(each.assign(**one_cloud, codec=name) for name, each in curves.items())
    _check(rows, "anchor", [quality])
    found = list(_curves(rows.reset_index(drop=True), [quality]))
    if not found or set(found[0].codecs) != set(curves):
        raise InputError(f"BD-rate: a curve has no values of {quality!r}")
    delta = found[0].delta("tested", "anchor")
    if delta["bd_rate_status"] != COMPARED:
        counts = ", ".join(
            f"{delta[name]} points of the {codec}"
            for codec, name in (("anchor", "anchor_points"), ("tested codec", "points"))
        )
        raise InputError(
            f"BD-rate: {delta['bd_rate_status']} ({counts}; shared range "
            f"{delta['shared_range']:.0%}): a curve needs {MIN_POINTS} points that are not "
            f"lossless, and half of the shorter range in common"
        )
    return _percent(delta["log_ratio"])


def _both_ways(row: dict[str, Any]) -> list[dict[str, Any]]:
    """Return a row of `_Curves.delta`, and the same row with codec and anchor exchanged."""
    swapped = dict(row)
    for mine, theirs in (("codec", "anchor"), *((name, f"anchor_{name}") for name in _OF_CURVE)):
        swapped[mine], swapped[theirs] = row[theirs], row[mine]
    return [row, swapped | {name: -row[name] for name in ("log_ratio", "bd_quality_db")}]


def _per_data_set(clouds: pd.DataFrame, margin_percent: float) -> pd.DataFrame:
    import pandas as pd

    rows = []
    for names, part in clouds.groupby([*_GROUP, "anchor"], sort=False):
        keys = dict(zip([*_GROUP, "anchor"], names, strict=True))
        rows.append({**keys, **_means(part, margin_percent), **_counts(part)})
    return pd.DataFrame(rows)


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
        where = f"{codec} of {'/'.join(filter(None, names))}"
        raise InputError(f"metrics table: column 'bpp' must be positive, but is not for {where}")
    check_peaks(metrics, qualities)


class _Curves:
    def __init__(self, names: dict[str, Any], rows: pd.DataFrame) -> None:
        self.names = names
        self.codecs = {
            str(codec): _curve(part) for codec, part in rows.groupby("codec", sort=False)
        }

    def delta(self, codec: str, anchor: str) -> dict[str, Any]:
        (tested, lossless), (base, exact) = self.codecs[codec], self.codecs[anchor]
        difference = bjontegaard_delta(base, tested)
        return {
            **self.names,
            "codec": codec,
            "anchor": anchor,
            "log_ratio": _number(difference.log_ratio),
            "bd_rate_status": difference.rate_status,
            "bd_quality_db": _number(difference.quality_db),
            "bd_quality_status": difference.quality_status,
            "shared_range": difference.overlap,
            "points": len(tested.quality),
            "anchor_points": len(base.quality),
            "pooled": tested.pooled,
            "anchor_pooled": base.pooled,
            LOSSLESS: lossless,
            f"anchor_{LOSSLESS}": exact,
        }


def _curves(metrics: pd.DataFrame, qualities: Sequence[str]) -> Iterator[_Curves]:
    for metric in qualities:
        rows = _with_quality(metrics, metric)
        counted = {str(name): _counted_bits(part, metric) for name, part in rows.groupby("dataset")}
        for (dataset, cloud), part in rows.groupby(["dataset", "cloud"], sort=False):
            bits = counted[str(dataset)]
            names = {"dataset": dataset, "metric": metric, "cloud": cloud, "bits_counted": bits}
            names |= {SCENE: part[SCENE].iloc[0]} if SCENE in part else {}
            yield _Curves(names, part.assign(bits=part[bits].fillna(part["bpp"])))


def _counted_bits(rows: pd.DataFrame, metric: str) -> str:
    """Return the column with the bits that count in a data set for a metric.

    They are the bits of the positions or of the attribute that the metric compares. All bits count
    if a codec does not tell how many of its bits these are, or if the metric compares both.
    """
    column = f"bpp_{_compared_by(metric)}"
    if column not in rows:
        return "bpp"
    is_unknown = rows[column].isna()
    if column == "bpp_geometry":  # codecs of positions only have one kind of bits
        errors = rows.reindex(columns=[f"{name}_max_error" for name in (COLOUR, REFLECTANCE)])
        is_unknown &= errors.notna().any(axis=1)
    return "bpp" if is_unknown.any() else column


def _compared_by(metric: str) -> str | None:
    """Return whether a metric compares positions, colours or reflectances; None for several."""
    return next((part for part, starts in _COMPARED.items() if metric.startswith(starts)), None)


def _with_quality(metrics: pd.DataFrame, name: str) -> pd.DataFrame:
    quality = _quality(metrics, name)
    if (part := _compared_by(name)) in (COLOUR, REFLECTANCE):
        exact = metrics.reindex(columns=[f"{part}_lossless"])[f"{part}_lossless"]
        lossless = np.isnan(quality) & exact.eq(True).to_numpy(bool)
    else:
        lossless = lossless_rows(metrics) & is_shape_metric(name)
        quality = np.where(lossless, np.nan, quality)
    rows = metrics.assign(**{LOSSLESS: lossless, "quality": quality})
    is_usable = rows["quality"].notna() | rows[LOSSLESS]
    has_gaps = (~is_usable).groupby(rows["dataset"]).transform("any")
    has_quality = rows["quality"].notna().groupby(rows["dataset"]).transform("any")
    return rows[is_usable & (has_quality | ~has_gaps)]


def _quality(metrics: pd.DataFrame, name: str) -> Floats:
    if name not in metrics:  # all rows are lossless
        return np.full(len(metrics), np.nan)
    values = metrics[name].to_numpy(dtype=float)
    unit = column_named(name).unit
    if unit == "dB":
        return values
    factor = -20 if unit in _LENGTHS else -10
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(values > 0, factor * np.log10(values), np.nan)


def _curve(rows: pd.DataFrame) -> tuple[RateDistortionCurve, int]:
    result = rate_distortion_curve(rows["bits"].to_numpy(float), rows["quality"].to_numpy(float))
    return result, int(rows[LOSSLESS].sum())


def _number(value: float | None) -> float:
    return np.nan if value is None else value


def _counts(part: pd.DataFrame) -> dict[str, Any]:
    status = part["bd_rate_status"]
    return {
        "clouds": len(part),
        "compared": int((status == COMPARED).sum()),
        **{name: int((status == value).sum()) for name, value in _STATUS.items()},
        "quality_compared": int((part["bd_quality_status"] == COMPARED).sum()),
        "bits_counted": part["bits_counted"].iloc[0],
        "shared_range": float(part["shared_range"].median()),
        "pooled": int(part["pooled"].sum()),
        "anchor_pooled": int(part["anchor_pooled"].sum()),
        LOSSLESS: int(part[LOSSLESS].sum()),
        f"anchor_{LOSSLESS}": int(part[f"anchor_{LOSSLESS}"].sum()),
    }


def _means(part: pd.DataFrame, margin_percent: float) -> dict[str, Any]:
    scenes = means_over_seeds(part, (), ("log_ratio", "bd_quality_db"))
    ratio, gain = (Estimate.of(scenes[name]) for name in ("log_ratio", "bd_quality_db"))
    return {
        **percent_columns("bd_rate_percent", ratio, margin_percent),
        "bd_quality_db": gain.mean,
        "bd_quality_db_low": gain.low,
        "bd_quality_db_high": gain.high,
    }


def percent_columns(name: str, log_ratio: Estimate, margin_percent: float) -> dict[str, Any]:
    """Return the columns of a table that tell a difference in percent, with interval and verdict.

    Parameters
    ----------
    name
        Name of the column of the difference, to which those of its ends add ``_low`` and others.
    log_ratio
        Estimate of the natural logarithm of the ratio, over scenes.
    margin_percent
        Difference in percent below which two codecs count as equal.
    """
    values = {"": log_ratio.mean, "_low": log_ratio.low, "_high": log_ratio.high}
    values |= {"_least": log_ratio.least, "_most": log_ratio.most}
    return {
        **{f"{name}{end}": _percent(value) for end, value in values.items()},
        "verdict": log_ratio.verdict(float(np.log1p(margin_percent / 100))),
        "scenes": log_ratio.scenes,
    }


def _percent(log_ratio: float) -> float:
    return 100 * float(np.expm1(log_ratio))

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from puckbench.metrics.interpolation import bits_to_reach
from puckbench.metrics.lossless import lossless_rows
from puckbench.metrics.statistics import (
    MIN_SCENES,
    NO_VERDICT,
    SCENE,
    UNDECIDED,
    Estimate,
    with_scenes,
)
from puckbench.metrics.timing import ranked_rows
from puckbench.results.columns import LOWER, Column
from puckbench.tables.rate_deltas import MARGIN_PERCENT
from puckbench.tables.registry import SEVERAL_CODECS, TABLES

if TYPE_CHECKING:
    import pandas as pd

CODE = ("puckbench.tables.rate_deltas",)

_NOISE_MM = 1.5
"""RMS error (D2) above which scans have errors other than the rounding of ranges."""
_MM = {
    "d1_rms_mm": "d1_rms_m",
    "largest_mm": "hausdorff_point_m",
    "truth_q99_mm": "truth_q99_point_m",
    "truth_d2_rms_mm": "truth_d2_rms_m",
}
_CURVE = ["bpp", "seconds", "real_time", "lossless", "lost", "ranked", *_MM]
_ZERO = 1e-6
"""Interpolated value (mm, s) below which a value counts as zero."""
SHOWN = ("bpp", "error_mm", "largest_mm", "seconds")


class Curve:
    """The results of a codec on one cloud at all its rates, from the fewest to the most bits."""

    def __init__(self, rows: pd.DataFrame) -> None:
        order = np.argsort(rows["bpp"].to_numpy())
        self.rates = [str(rows["rate"].iloc[place]) for place in order]
        self.columns = {name: rows[name].to_numpy(float)[order] for name in _CURVE}
        self.bits = self.columns["bpp"]

    def within(self, column: str, limit: float, kept: NDArray[np.bool_] | bool = True) -> float:
        """Return the fewest bits at which a result is small enough.

        Parameters
        ----------
        column
            Name of the result.
        limit
            Largest allowed value.
        kept
            Mask (k,) of the rates that may be chosen; by default, all.

        Returns
        -------
        float
            Bits per point, interpolated between rates (see `bits_to_reach`), or nan if there are
            none.
        """
        kept = kept & ~np.isnan(self.columns[column])
        return bits_to_reach(self.bits[kept], self.columns[column][kept], limit)

    def at(self, bits: float, column: str, rate: str = "") -> float:
        """Return a result at a given rate, or interpolated at a given number of bits.

        Interpolation is linear on log-log axes. Rates without a value are left out.

        Parameters
        ----------
        bits
            Bits per point.
        column
            Name of the result.
        rate
            Name of a rate. If the codec has this rate, `bits` is not used.
        """
        values = self.columns[column]
        if rate in self.rates:
            return float(values[self.rates.index(rate)])
        known = ~np.isnan(values)
        if not known.any():
            return float("nan")
        logs = np.log(np.maximum(values[known], _ZERO / 10))
        value = float(np.exp(np.interp(np.log(bits), np.log(self.bits[known]), logs)))
        return value if value > _ZERO else 0.0


@dataclass(frozen=True)
class Use:
    """A use of codecs, such as archiving, for which a table ranks them.

    Parameters
    ----------
    words
        Text that says what the use requires.
    error
        Column of the error that is shown in ``error_mm``.
    choose
        Function that returns the bits at which a codec serves the use on a cloud, or nan if it does
        not. Its arguments are the codec's `Curve` on this cloud and the name of the rate that is
        nearest to the truth in the other scenes.
    by_error
        Whether codecs are ranked by least error. Otherwise they are ranked by fewest bits.
    in_time
        Whether the ranking depends on measured times.
    """

    words: str
    error: str
    choose: Callable[[Curve, str], float]
    by_error: bool = False
    in_time: bool = False


def _within(column: str, limit: float) -> Callable[[Curve, str], float]:
    return lambda curve, _: curve.within(column, limit)


def _lossless(curve: Curve, _: str) -> float:
    complete = (curve.columns["lossless"] > 0) & (curve.columns["lost"] == 0)
    return float(min(curve.bits[complete], default=np.nan))


def _in_real_time(curve: Curve, _: str) -> float:
    return curve.within("d1_rms_mm", 5.0, curve.columns["real_time"] >= 1)


def _nearest(curve: Curve, nearest: str) -> float:
    return float(curve.bits[curve.rates.index(nearest)]) if nearest in curve.rates else np.nan


USES: Mapping[str, Use] = {
    "archive": Use("archive without loss", "d1_rms_mm", _lossless),
    "within_5_mm": Use("RMS error of at most 5 mm (D1)", "d1_rms_mm", _within("d1_rms_mm", 5.0)),
    "map": Use(
        "map: 99 % of points within 50 mm of the true surface",
        "truth_q99_mm",
        _within("truth_q99_mm", 50.0),
    ),
    "nearest": Use("nearest to the true surface (D2)", "truth_d2_rms_mm", _nearest, by_error=True),
    "real_time": Use(
        "at most 5 mm, coded and decoded as fast as the sensor turns, on one thread",
        "d1_rms_mm",
        _in_real_time,
        in_time=True,
    ),
}
FEWEST, NEAREST = "fewest bits", "nearest"


@TABLES.register(
    "uses",
    title="Which codec for what",
    needs=(SEVERAL_CODECS,),
    timed={"seconds": (), "use": [name for name, use in USES.items() if use.in_time]},
    columns=[
        Column("use", "Use"),
        Column("error_mm", "Error", "mm", LOWER),
        Column("ratio", "Ratio to the best codec", better=LOWER, missing="not in every scene"),
    ],
    shown=("dataset", "use", "codec", "bpp", "error_mm", "ratio", "verdict", "scenes"),
)
def uses(
    metrics: pd.DataFrame,
    scan_errors: pd.DataFrame | None = None,
    margin_percent: float = MARGIN_PERCENT,
) -> pd.DataFrame:
    """The table lists the codecs that serve a use, the best first, by data set.

    ``use`` is one of five. ``archive`` allows lossless rates only. ``within_5_mm`` allows a D1 RMS
    error of at most 5 mm. ``map`` requires that 99 % of the distances between decoded points and
    the true surface, either way, are at most 50 mm. ``nearest`` asks for the least RMS distance of
    a noisy scan to the true surface (D2), at the rate that is best in the other scenes.
    ``real_time`` allows an error of 5 mm, and requires that coding and decoding on one thread are
    no slower than the sensor turns.

    ``bpp`` is the fewest bits per point, interpolated on log-log axes between rates, or those of
    the lowest rate if it is already good enough. ``error_mm`` is the error that the use is about.
    ``largest_mm`` is the largest distance to the original, point to point. ``seconds`` is the time
    to encode and decode a million points. Values are geometric means over scenes, or arithmetic
    means if a value is 0. ``ratio`` is the number of bits (for ``nearest``, the error) relative to
    the best codec, with a 95 % interval by Student's t from six scenes on.

    ``verdict`` is "fewest bits" or "nearest" if the best codec is better than each other codec.
    This includes codecs that serve the use only in some scenes, which are compared in these scenes.
    The verdict on other codecs is "worse", "not worse" (by more than the margin), or "undecided".
    It is "no verdict" below six scenes, or if times were not measured three times without other
    jobs. Codecs that serve the use only in some scenes come last, without a verdict.
    """
    import pandas as pd

    rows = with_scenes(metrics).assign(
        lossless=lossless_rows(metrics), ranked=ranked_rows(metrics), seconds=_seconds(metrics)
    )
    rows = rows.assign(real_time=_real_time(rows), lost=_lost(rows), **_in_mm(rows))
    noisy = _noisy(scan_errors)
    table: list[dict[str, Any]] = []
    for dataset, part in rows.groupby("dataset", sort=False):
        scenes = part[SCENE].nunique()
        curves = {
            str(codec): (
                of_codec,
                [(scene, Curve(each)) for (scene, _), each in of_codec.groupby([SCENE, "cloud"])],
            )
            for codec, of_codec in part.groupby("codec", sort=False)
        }
        for name, use in USES.items():
            if use.by_error and dataset not in noisy:
                continue
            served = {
                codec: values
                for codec, of_codec in curves.items()
                if len(values := _served(*of_codec, use))
            }
            is_timed = not use.in_time or all(_is_timed(each) for _, each in curves.values())
            margin = float(np.log1p(margin_percent / 100))
            table += [
                {"dataset": dataset, "use": name, **row}
                for row in _ranked(served, scenes, use, margin, is_timed)
            ]
    columns = ["dataset", "use", "codec", *SHOWN, "ratio", "ratio_low", "ratio_high"]
    return pd.DataFrame(table, columns=[*columns, "verdict", "scenes"])


def _noisy(scan_errors: pd.DataFrame | None) -> set[str]:
    """Return the names of data sets whose scans have errors."""
    if scan_errors is None or "truth_d2_rms_m" not in scan_errors:
        return set()
    medians = scan_errors.groupby("dataset")["truth_d2_rms_m"].median()
    return set(medians.index[1000 * medians > _NOISE_MM])


def _in_mm(rows: pd.DataFrame) -> dict[str, Any]:
    return {name: 1000 * rows[column] if column in rows else np.nan for name, column in _MM.items()}


def _seconds(rows: pd.DataFrame) -> Any:
    times = rows.reindex(columns=["encode_s", "decode_s"]).sum(axis=1, min_count=2)
    return 1e6 * times / rows.reindex(columns=["points_in"])["points_in"]


def _real_time(rows: pd.DataFrame) -> Any:
    speeds = rows.reindex(columns=["encode_real_time", "decode_real_time"])
    threads = rows.reindex(columns=["threads"])["threads"]
    return speeds.min(axis=1, skipna=False).where(threads.eq(1))


def _lost(rows: pd.DataFrame) -> Any:
    """Return the numbers of lost points; 0 where the numbers of points are not known."""
    counts = rows.reindex(columns=["points_in", "points_out"])
    return (counts["points_in"] - counts["points_out"]).clip(lower=0).fillna(0)


def _is_timed(curves: list[tuple[Any, Curve]]) -> bool:
    """Return whether times were measured well enough to decide if a codec is fast enough.

    Codecs that do not reach an error of 5 mm need no times.
    """
    columns = [curve.columns for _, curve in curves if np.isfinite(curve.within("d1_rms_mm", 5.0))]
    return all(each["ranked"].all() and not np.isnan(each["real_time"]).any() for each in columns)


def _served(rows: pd.DataFrame, curves: list[tuple[Any, Curve]], use: Use) -> pd.DataFrame:
    """Return a codec's values by scene, for the scenes in which it serves a use on every cloud."""
    import pandas as pd

    nearest = _nearest_rates(rows) if use.by_error else {}
    values = []
    for scene, curve in curves:
        rate = nearest.get(scene, "")
        bits = use.choose(curve, rate)
        shown = {"error_mm": use.error, "largest_mm": "largest_mm", "seconds": "seconds"}
        row = dict.fromkeys(shown, np.nan)
        if np.isfinite(bits):
            row = {name: curve.at(bits, column, rate) for name, column in shown.items()}
        is_served = np.isfinite(bits) and np.isfinite(row["error_mm"])
        values.append({SCENE: scene, "bpp": bits, **row, "served": is_served})
    table = pd.DataFrame(values).groupby(SCENE).mean()
    return table[table["served"] == 1]


def _nearest_rates(rows: pd.DataFrame) -> dict[Any, str]:
    """Return, by scene, the rate with the least mean log distance to the truth in all others."""
    errors = rows.groupby([SCENE, "rate"])["truth_d2_rms_mm"].mean().unstack()
    known = errors.dropna(axis="columns", how="all").dropna(axis="index", how="all")
    logs: pd.DataFrame = known.transform("log")
    if logs.empty:
        return {}
    others = {scene: logs.drop(scene) if len(logs) > 1 else logs for scene in logs.index}
    return {scene: str(each.mean().dropna().idxmin()) for scene, each in others.items()}


def _ranked(
    served: Mapping[str, pd.DataFrame], scenes: int, use: Use, margin: float, is_timed: bool
) -> Iterator[dict[str, Any]]:
    score = "error_mm" if use.by_error else "bpp"
    whole = {codec: values for codec, values in served.items() if len(values) == scenes}
    order = sorted(whole, key=lambda codec: Estimate.of_ratios(whole[codec][score]).mean)
    ratios = {
        codec: Estimate.of(np.log(whole[codec][score] / whole[order[0]][score]))
        for codec in order[1:]
    }
    can_rank = is_timed and scenes >= MIN_SCENES
    partly = [codec for codec in served if codec not in whole]
    partly.sort(key=lambda codec: (-len(served[codec]), _mean(served[codec][score])))
    rivals = [*ratios.values()]
    for codec in partly if order else ():
        there = (served[codec][score] / whole[order[0]][score]).dropna()
        rivals.append(Estimate.of(np.log(there)))
    for codec in [*order, *partly]:
        values, verdict = served[codec], NO_VERDICT
        ratio = {"ratio": 1.0} if codec in order else {}
        if codec in ratios:
            estimate = ratios[codec]
            ends = {"": estimate.mean, "_low": estimate.low, "_high": estimate.high}
            ratio = {f"ratio{end}": float(np.exp(value)) for end, value in ends.items()}
            if can_rank:
                verdict = estimate.verdict(margin)
        elif codec in order and can_rank and rivals:
            is_best = all(other.low > 0 for other in rivals)
            verdict = (NEAREST if use.by_error else FEWEST) if is_best else UNDECIDED
        shown = {name: _mean(values[name]) for name in SHOWN}
        yield {"codec": codec, **shown, **ratio, "verdict": verdict, "scenes": len(values)}


def _mean(values: pd.Series[float]) -> float:
    """Return the geometric mean or, if a value is 0, the arithmetic mean."""
    return float(values.mean() if values.eq(0).any() else Estimate.of_ratios(values).mean)

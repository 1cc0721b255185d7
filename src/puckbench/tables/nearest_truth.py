from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from puckbench.metrics.interpolation import bits_to_reach
from puckbench.metrics.statistics import SCENE, Estimate, means_over_seeds
from puckbench.results.columns import GRID, HIGHER, LOWER, Column, column_named
from puckbench.tables.registry import SEVERAL_CODECS, TABLES, TRUTH

if TYPE_CHECKING:
    import pandas as pd

DISTANCES = {
    "accuracy, plane": "truth_acd_ba_plane",
    "accuracy, point": "truth_acd_ba_point",
    "completeness, plane": "truth_acd_ab_plane",
    "completeness, point": "truth_acd_ab_point",
    "Chamfer, plane": "truth_cd_plane",
    "Chamfer, point": "truth_cd_point",
    "D2": "truth_d2_mse",
    "D1": "truth_d1_mse",
    "99 %": "truth_q99_point",
    "largest": "truth_hausdorff_point",
}
_CLOUD = ["dataset", "cloud"]
_EXACT_MM = 0.1
"""Distance below which a scan counts as error-free."""


@TABLES.register(
    "nearest_truth",
    title="How near to the true surface",
    needs=(TRUTH,),
    columns=[
        Column("scan_mm", "Distance of the scan", "mm"),
        Column("percent_of_scan", "Distance relative to the scan's", "%", LOWER),
    ],
    shown=("dataset", "codec", "distance", "rate", "bpp", "mm", "percent_of_scan", "scenes"),
)
def nearest_truth(metrics: pd.DataFrame, scan_errors: pd.DataFrame) -> pd.DataFrame:
    """The table shows how far decoded clouds are from the true surface, beside the noisy scan.

    There is a row for each codec, rate and kind of ``distance``: from decoded points to the surface
    (accuracy), from points of the surface to decoded points (completeness), both (Chamfer, D2, D1),
    or the 99 % quantile and the largest of both (point to point). ``scan_mm`` and ``mm`` are RMS
    distances of the scan and of the decoded cloud; for the last two kinds they are the distance
    itself. ``percent_of_scan`` is the ratio of both. Below 100, the decoded points are nearer to
    the truth than the scan.

    Values are geometric means over scenes. From six scenes on, ``low`` and ``high`` are 95 %
    intervals by Student's t of the logarithm. ``least`` and ``most`` are the extremes. Scans
    without errors are left out.
    """
    import pandas as pd

    table: list[dict[str, Any]] = []
    names = ["dataset", "codec", "distance", "rate"]
    for keys, part in _distances(metrics, scan_errors).groupby(names, sort=False):
        share = Estimate.of_ratios(part["mm"] / part["scan_mm"])
        values = [("", share.mean), ("_low", share.low), ("_high", share.high)]
        values += [("_least", share.least), ("_most", share.most)]
        table.append(
            {
                **dict(zip(names, keys, strict=True)),
                "bpp": Estimate.of_ratios(part["bpp"]).mean,
                "scan_mm": Estimate.of_ratios(part["scan_mm"]).mean,
                "mm": Estimate.of_ratios(part["mm"]).mean,
                **{f"percent_of_scan{end}": 100 * value for end, value in values},
                "scenes": share.scenes,
            }
        )
    return pd.DataFrame(table)


@TABLES.register(
    "truth_bits",
    title="Bits for an equal distance to the truth",
    needs=(TRUTH, SEVERAL_CODECS),
    columns=[
        Column("anchor_bpp", "Bits per point of the anchor", "bpp"),
        Column("bits_ratio", "Bits of the anchor per bit", better=HIGHER, missing="no scene"),
        Column("of", "Scenes that both coded"),
    ],
)
def truth_bits(metrics: pd.DataFrame, scan_errors: pd.DataFrame, anchor: str) -> pd.DataFrame:
    """The table shows how many times a codec's bits the anchor needs to be as near to the truth.

    There is a row for each of the anchor's rates. ``mm`` is the distance of the anchor to the true
    surface at its ``rate`` (as in ``nearest_truth``). ``bits_ratio`` is the quotient of the
    anchor's bits at this rate and the codec's bits at the same distance, interpolated linearly on
    log-log axes. It is a lower bound if the codec's lowest rate is as near. Values are geometric
    means over the ``scenes`` in which the codec gets as near, with 95 % intervals from six scenes
    on. ``of`` is the number of scenes that both coded.
    """
    import pandas as pd

    rows = []
    distances = _distances(metrics, scan_errors)
    for (dataset, distance), part in distances.groupby(["dataset", "distance"], sort=False):
        curves = {
            str(codec): {scene: rows.sort_values("bpp") for scene, rows in each.groupby(SCENE)}
            for codec, each in part.groupby("codec", sort=False)
        }
        base = part[part["codec"] == anchor]
        for codec in [name for name in curves if name != anchor]:
            for rate, goals in base.groupby("rate", sort=False):
                common = goals[goals[SCENE].isin(curves[codec])]
                ratio = Estimate.of_ratios(_ratios(common, curves[codec]))
                rows.append(
                    {
                        "dataset": dataset,
                        "distance": distance,
                        "codec": codec,
                        "anchor": anchor,
                        "rate": rate,
                        "mm": Estimate.of_ratios(common["mm"]).mean,
                        "anchor_bpp": Estimate.of_ratios(common["bpp"]).mean,
                        "bits_ratio": ratio.mean,
                        "bits_ratio_low": ratio.low,
                        "bits_ratio_high": ratio.high,
                        "scenes": ratio.scenes,
                        "of": len(common),
                    }
                )
    columns = ["dataset", "distance", "codec", "anchor", "rate"]
    return pd.DataFrame(rows) if rows else pd.DataFrame(columns=columns)


def _ratios(goals: pd.DataFrame, curves: dict[Any, pd.DataFrame]) -> Iterator[float]:
    for scene, bits, goal in goals[[SCENE, "bpp", "mm"]].itertuples(index=False):
        curve = curves[scene]
        reached = bits_to_reach(curve["bpp"].to_numpy(), curve["mm"].to_numpy(), goal)
        yield bits / reached


def _distances(metrics: pd.DataFrame, scan_errors: pd.DataFrame) -> pd.DataFrame:
    """Return bits and distances in mm by data set, codec, kind of distance, rate and scene."""
    import pandas as pd

    columns = {name: source for name, source in DISTANCES.items() if source in scan_errors}
    columns = {name: source for name, source in columns.items() if source in metrics}
    scans = scan_errors.dropna(subset=list(columns.values()), how="all")
    rows = metrics.merge(scans[[*_CLOUD, *columns.values()]], on=_CLOUD, suffixes=("", "_scan"))
    if not columns or rows.empty:
        raise InputError("scan errors table: no scan with a true surface")
    parts = []
    for name, source in columns.items():
        scaled = rows.assign(
            distance=name,
            mm=_millimetres(rows, rows[source], column_named(source).unit),
            scan_mm=_millimetres(rows, rows[f"{source}_scan"], column_named(source).unit),
        )
        parts.append(scaled[scaled["scan_mm"] > _EXACT_MM])
    scaled = pd.concat(parts)
    if scaled.empty:
        raise InputError("scan errors table: no scan with errors")
    keys = ["dataset", "codec", "distance", "rate"]
    return means_over_seeds(scaled, keys, ["bpp", "mm", "scan_mm"])


def _millimetres(rows: pd.DataFrame, distances: pd.Series[float], unit: str) -> Floats:
    values = distances.to_numpy(float)
    lengths = values if unit == GRID else np.sqrt(values)
    return np.asarray(1000 * lengths / rows["scale"].to_numpy(float))

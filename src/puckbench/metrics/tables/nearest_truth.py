from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.metrics.scenes import SCENE, means_over_seeds, median_interval
from puckbench.metrics.table_registry import TABLES, TRUTH

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
}
_CLOUD = ["dataset", "cloud"]
_EXACT_MM = 0.1
"""Distance below which a scan counts as error-free."""


@TABLES.register("nearest_truth", title="How near to the true surface", needs=(TRUTH,))
def nearest_truth(metrics: pd.DataFrame, scan_errors: pd.DataFrame, anchor: str) -> pd.DataFrame:
    """Smallest distance to the true surface that each codec reaches at any rate, beside the
    distance of the noisy scan, and the bits at this best rate.

    ``distance``: from decoded points to the surface (accuracy), from points of the surface to
    decoded points (completeness), or both (Chamfer, D2, D1); point to point or point to plane.
    ``scan_mm``, ``least_mm``: RMS distance of the scan and of the best rate. ``percent_of_scan``:
    their ratio (below 100: the decoded points are nearer to the truth than the scan). ``rates``:
    number of rates with a median ratio below 100. ``bpp``: bits per point at the best rate.
    ``bits_ratio``: the anchor's bits at its smallest distance over the codec's bits at the same
    distance, interpolated linearly on log-log axes; a lower bound if the codec's lowest rate is as
    near. Values are medians over scenes of means over seeds, with 95 % bootstrap intervals
    (``..._low``, ``..._high``). ``reached``: number of scenes with a ``bits_ratio``. Scans without
    errors are left out.
    """
    import pandas as pd

    columns = {name: column for name, column in DISTANCES.items() if column in scan_errors}
    scans = scan_errors.dropna(subset=list(columns.values()), how="all")
    rows = metrics.merge(scans[[*_CLOUD, *columns.values()]], on=_CLOUD, suffixes=("", "_scan"))
    if not columns or rows.empty:
        raise InputError("scan errors table: no scan with a true surface")
    table: list[dict[str, Any]] = []
    for name, column in columns.items():
        scaled = rows.assign(
            mm=_millimetres(rows, column), scan_mm=_millimetres(rows, f"{column}_scan")
        )
        keys = ["dataset", "codec", "rate"]
        means = means_over_seeds(scaled, keys, ["bpp", "mm", "scan_mm"])
        for dataset, part in means[means["scan_mm"] > _EXACT_MM].groupby("dataset", sort=False):
            curves = {
                str(codec): _Curves(curve) for codec, curve in part.groupby("codec", sort=False)
            }
            for codec, tested in curves.items():
                about = {"dataset": dataset, "codec": codec, "distance": name}
                table.append({**about, **tested.row(curves.get(anchor), str(dataset), codec, name)})
    if not table:
        raise InputError("scan errors table: no scan with errors")
    return pd.DataFrame(table)


def _millimetres(rows: pd.DataFrame, column: str) -> Floats:
    return np.asarray(1000 * np.sqrt(rows[column].to_numpy(float)) / rows["scale"].to_numpy(float))


class _Curves:
    """A codec's distance and bits at each rate, by scene."""

    def __init__(self, rows: pd.DataFrame) -> None:
        best = rows.loc[rows.groupby(SCENE)["mm"].idxmin()].set_index(SCENE)
        ratio = rows["mm"] / rows["scan_mm"]
        self.best = best.assign(percent=100 * best["mm"] / best["scan_mm"])
        self.rates_below = int((ratio.groupby(rows["rate"]).median() < 1).sum())
        self.scenes = {
            scene: curve.sort_values("bpp")[["bpp", "mm"]].to_numpy(float)
            for scene, curve in rows.groupby(SCENE)
        }

    def row(self, anchor: _Curves | None, *names: str) -> dict[str, float]:
        ratios = np.full(0, np.nan) if anchor is None else self._bits_ratios(anchor)
        reached = ratios[~np.isnan(ratios)]
        percent_low, percent_high = median_interval(self.best["percent"].to_numpy(float), *names)
        low, high = median_interval(reached, *names, "bits")
        return {
            "scan_mm": float(self.best["scan_mm"].median()),
            "least_mm": float(self.best["mm"].median()),
            "percent_of_scan": float(self.best["percent"].median()),
            "percent_of_scan_low": percent_low,
            "percent_of_scan_high": percent_high,
            "rates": self.rates_below,
            "bpp": float(self.best["bpp"].median()),
            "bits_ratio": float(np.median(reached)) if len(reached) else np.nan,
            "bits_ratio_low": low,
            "bits_ratio_high": high,
            "scenes": len(self.best),
            "reached": len(reached),
        }

    def _bits_ratios(self, anchor: _Curves) -> Floats:
        common = [scene for scene in self.scenes if scene in anchor.scenes]
        goals = anchor.best.loc[common, ["bpp", "mm"]].to_numpy(float)
        ratios = [
            bits / bits_to_reach(self.scenes[scene][:, 0], self.scenes[scene][:, 1], goal)
            for scene, (bits, goal) in zip(common, goals, strict=True)
        ]
        return np.array(ratios)


def bits_to_reach(bits: Floats, distances: Floats, goal: float) -> float:
    """Return the fewest bits at which a curve's distance is at most `goal`, or nan.

    `bits` (n,) ascend; interpolation is linear in log bits and log distance.
    """
    near = np.flatnonzero(distances <= goal)
    if len(near) == 0:
        return float("nan")
    first = near[0]
    if first == 0:
        return float(bits[0])
    pair = slice(first - 1, first + 1)
    log_distance = np.log(np.maximum(distances[pair], 1e-9))[::-1]
    return float(np.exp(np.interp(np.log(goal), log_distance, np.log(bits[pair])[::-1])))

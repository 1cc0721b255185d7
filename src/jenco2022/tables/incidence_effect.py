from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jenco2022.published import BIN_STDS_M, FAR_M, LARGEST_RAD
from pointkit.errors import InputError
from puckbench.results.columns import Column
from puckbench.tables.registry import SENSOR, TABLES

if TYPE_CHECKING:
    import pandas as pd

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")

BINS = len(BIN_STDS_M)


_BINS = [
    Column("low_rad", "Incidence from", "rad"),
    Column("high_rad", "Incidence to", "rad"),
    Column("thesis_real_std_m", "Std of real residuals in the thesis", "m"),
]
_EFFECTS = {
    "range_error_std_m": "Range error std",
    "rms_cos": "RMS cosine of the incidence",
    "predicted_std_m": "Predicted std",
    "surface_distance_std_m": "Surface distance std",
    "plane_residual_std_m": "Plane residual std",
}


@TABLES.register(
    "residual_incidence", title="Plane residuals by incidence", category=SENSOR, columns=_BINS
)
def incidence_table(residuals: pd.DataFrame) -> pd.DataFrame:
    """Mean and standard deviation of the plane residuals in ten bins of the angle of incidence.

    Bins and ``thesis_real_std_m``, the real sensor's standard deviations, are from thesis figure
    5.15. Walls and floors are nearer than 30 m.
    """
    near = residuals[residuals["distance_m"] < FAR_M]
    table = incidence_bins(near)
    place = np.round(table["low_rad"] / (LARGEST_RAD / BINS)).astype(int)
    return table.assign(thesis_real_std_m=np.array(BIN_STDS_M)[place])


@TABLES.register(
    "incidence_effect", title="The effect of incidence", category=SENSOR, columns=_EFFECTS
)
def incidence_effect(scans: pd.DataFrame, residuals: pd.DataFrame) -> pd.DataFrame:
    """Range error and distance from the surface by error model and angle of incidence.

    At incidence theta, a range error e moves a point e cos(theta) off the surface (section 5.6).
    The standard deviation of this distance is given three times: predicted, measured from the true
    surface (scans at 1 and 5 m), and measured from the fitted plane (all distances below 30 m).

    Parameters
    ----------
    scans
        Points of virtual scans, as `wall_points` returns them.
    residuals
        Plane residuals of virtual scans and captures.
    """
    near = scans[(scans["distance_m"] < FAR_M) & scans["surface"].isin(("wall", "floor"))]
    distance = np.where(near["surface"] == "wall", near["y_m"], near["z_m"])
    squared_cos = np.cos(near["incidence_rad"].astype(float)) ** 2
    effect = incidence_bins(near.assign(residual_m=near["range_error_m"]))
    effect = effect.rename(columns={"std_m": "range_error_std_m"}).drop(columns="mean_m")
    effect["rms_cos"] = np.sqrt(incidence_bins(near.assign(residual_m=squared_cos))["mean_m"])
    effect["predicted_std_m"] = effect["range_error_std_m"] * effect["rms_cos"]
    effect["surface_distance_std_m"] = incidence_bins(near.assign(residual_m=distance))["std_m"]
    fitted = incidence_table(residuals)[["model", "low_rad", "std_m"]]
    fitted = fitted.rename(columns={"std_m": "plane_residual_std_m"})
    return effect.merge(fitted, on=["model", "low_rad"], how="left")


def incidence_bins(
    table: pd.DataFrame, bins: int = BINS, highest_rad: float = LARGEST_RAD
) -> pd.DataFrame:
    """Return mean and standard deviation of residuals in bins of the angle of incidence.

    Parameters
    ----------
    table
        Residuals, with the columns ``model``, ``incidence_rad`` and ``residual_m``.
    bins
        Number of bins of equal width.
    highest_rad
        Upper end of the last bin, in rad; the first bin begins at 0.

    Returns
    -------
    DataFrame
        A row for each error model and bin that has residuals: ``low_rad`` and ``high_rad``, the
        ends of the bin, ``count``, ``mean_m`` and ``std_m``.

    Raises
    ------
    InputError
        The table has no rows.
    """
    if table.empty:
        raise InputError("incidence bins need at least one residual")
    angles = table["incidence_rad"].to_numpy(dtype=np.float64)
    number = np.minimum(np.floor(angles * (bins / highest_rad)), bins - 1)
    rows = table.assign(bin=number, residual_m=table["residual_m"].astype(np.float64))
    groups = rows[angles <= highest_rad].groupby(["model", "bin"], observed=True)["residual_m"]
    result = groups.agg(count="count", mean_m="mean", std_m="std").reset_index()
    result.insert(1, "low_rad", result["bin"] * (highest_rad / bins))
    result.insert(2, "high_rad", (result.pop("bin") + 1) * (highest_rad / bins))
    return result

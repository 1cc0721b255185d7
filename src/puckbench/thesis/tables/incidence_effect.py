"""Why noise along the ray cannot widen residuals at large incidence: Figure 5.21 in numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from puckbench.metrics.table_registry import SENSOR, TABLES
from puckbench.thesis.published import BIN_STDS_M, FAR_M, LARGEST_RAD
from puckbench.thesis.residuals.spread import incidence_bins

if TYPE_CHECKING:
    import pandas as pd

BINS = len(BIN_STDS_M)


@TABLES.register("residual_incidence", title="Plane residuals by incidence", category=SENSOR)
def incidence_table(residuals: pd.DataFrame) -> pd.DataFrame:
    """Mean and standard deviation of the plane residuals in ten bins of the angle of incidence.

    From 0 to 1.315 rad, walls and floors nearer than 30 m together (the bins of thesis figure
    5.15), beside the standard deviations of the thesis's real sensor in the same bins, which grow
    in the last ones.

    Returns
    -------
    pd.DataFrame
        ``model``, ``low_rad``, ``high_rad``, ``count``, ``mean_m``, ``std_m``,
        ``thesis_real_std_m``.
    """
    near = residuals[residuals["distance_m"] < FAR_M]
    table = incidence_bins(near, BINS, highest_rad=LARGEST_RAD)
    place = np.round(table["low_rad"] / (LARGEST_RAD / BINS)).astype(int)
    return table.assign(thesis_real_std_m=np.array(BIN_STDS_M)[place])


@TABLES.register("incidence_effect", title="The effect of incidence", category=SENSOR)
def incidence_effect(scans: pd.DataFrame, residuals: pd.DataFrame) -> pd.DataFrame:
    """The effect of thesis figure 5.21 in numbers, per error model and bin of incidence.

    The standard deviation of the range error along the ray, the root mean square of cos(incidence),
    their product, which the residual should have (a point e off along its ray is e cos(theta) off
    the surface, section 5.6), and the standard deviation measured against the true wall or floor
    and against the fitted plane (from all distances nearer than 30 m; the other columns from the
    scans at 1 and 5 m). With ``vlp16_incidence`` the range error grows with incidence, the distance
    to the surface does not.

    Parameters
    ----------
    scans
        Points as `wall_points` makes them.
    residuals
        A residual table.

    Returns
    -------
    pd.DataFrame
        ``model``, ``low_rad``, ``high_rad``, ``count``, ``range_error_std_m``, ``rms_cos``,
        ``predicted_std_m``, ``surface_distance_std_m``, ``plane_residual_std_m``.
    """
    near = scans[(scans["distance_m"] < FAR_M) & scans["surface"].isin(("wall", "floor"))]
    off = np.where(near["surface"] == "wall", near["y_m"], near["z_m"])
    squares = np.cos(near["incidence_rad"].astype(float)) ** 2
    effect = _std(near.assign(residual_m=near["range_error_m"]))
    effect = effect.rename(columns={"std_m": "range_error_std_m"}).drop(columns="mean_m")
    effect["rms_cos"] = np.sqrt(_std(near.assign(residual_m=squares))["mean_m"])
    effect["predicted_std_m"] = effect["range_error_std_m"] * effect["rms_cos"]
    effect["surface_distance_std_m"] = _std(near.assign(residual_m=off))["std_m"]
    fitted = incidence_table(residuals)[["model", "low_rad", "std_m"]]
    named = fitted.rename(columns={"std_m": "plane_residual_std_m"})
    return effect.merge(named, on=["model", "low_rad"], how="left")


def _std(table: pd.DataFrame) -> pd.DataFrame:
    return incidence_bins(table, BINS, highest_rad=LARGEST_RAD)

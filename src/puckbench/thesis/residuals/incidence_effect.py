"""Why noise along the ray cannot widen residuals at large incidence: Figure 5.21 in numbers."""

from __future__ import annotations

import numpy as np
import pandas as pd

from puckbench.thesis.published import BIN_STDS_M, FAR_M, LARGEST_RAD
from puckbench.thesis.residuals.spread import incidence_bins

BINS = len(BIN_STDS_M)


def incidence_table(residuals: pd.DataFrame) -> pd.DataFrame:
    """Residuals nearer than 30 m in the thesis's ten bins, its real sensor's beside (Figure 5.15).

    Columns: ``model``, ``low_rad``, ``high_rad``, ``count``, ``mean_m``, ``std_m``,
    ``thesis_real_std_m``.
    """
    near = residuals[residuals["distance_m"] < FAR_M]
    table = incidence_bins(near, BINS, highest_rad=LARGEST_RAD)
    place = np.round(table["low_rad"] / (LARGEST_RAD / BINS)).astype(int)
    return table.assign(thesis_real_std_m=np.array(BIN_STDS_M)[place])


def incidence_effect(scans: pd.DataFrame, residuals: pd.DataFrame) -> pd.DataFrame:
    """Range error, cosine and plane residual in the thesis's ten bins of incidence, per model.

    scans: points as `wall_points` makes them; residuals: a residual table. Columns: ``model``,
    ``low_rad``, ``high_rad``, ``count``, ``range_error_std_m`` along the ray, ``rms_cos`` of the
    incidence, ``predicted_std_m`` (their product: a point e off along its ray is e cos(theta) off
    the surface, section 5.6), ``surface_distance_std_m`` to the true wall or floor, and
    ``plane_residual_std_m`` to the fitted one, over all distances nearer than 30 m.
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

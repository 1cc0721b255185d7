"""Points of wall and floor scans: where they lie, and how far off along the ray."""

import numpy as np
import pandas as pd
import pytest

from jenco2022.residuals.tables import JOINED
from jenco2022.residuals.virtual import (
    POINT_COLUMNS,
    POINT_SURFACES,
    Procedure,
    scan_residuals,
    wall_points,
)
from virtual_lidar import Sweep

COARSE = Sweep(frames_skipped=1, azimuth_step_deg=0.5)


def points(model: str, distance: float, keep: int | None = None) -> pd.DataFrame:
    return wall_points(Procedure(model, sweep=COARSE, keep=keep), [distance], seed=1)


def test_points_lie_in_the_wall_s_frame() -> None:
    table = points("none", 3)
    assert tuple(table) == POINT_COLUMNS == JOINED["scans"]
    wall, floor, rest = (table[table["surface"] == name] for name in POINT_SURFACES)
    assert wall["y_m"].abs().max() < 1e-6
    assert floor["z_m"].abs().max() < 1e-6
    assert wall["x_m"].abs().max() <= 0.8 + 1e-6
    assert wall["z_m"].between(-1e-6, 2.2 + 1e-6).all()
    assert floor["y_m"].between(-1e-6, 3 + 1e-6).all()
    assert rest["x_m"].abs().max() == pytest.approx(2.5, abs=1e-3)
    # The sensor stands at (0, 3, 1): the ray's angle to the wall's normal.
    away = np.hypot(wall["x_m"], wall["z_m"] - 1)
    assert np.arctan2(away, 3).to_numpy() == pytest.approx(wall["incidence_rad"], abs=1e-5)


def test_they_are_the_points_that_residuals_are_taken_from() -> None:
    table = points("vlp16", 2)
    residuals = scan_residuals(Procedure("vlp16", sweep=COARSE), 2, 1, seed=1)
    for surface, column in (("wall", "y_m"), ("floor", "z_m")):
        off = table.loc[table["surface"] == surface, column].to_numpy()
        residual = residuals.loc[residuals["surface"] == surface, "residual_m"].to_numpy()
        assert np.corrcoef(off, residual)[0, 1] > 0.95  # the fitted plane is a little off the true


def test_the_range_error_grows_with_incidence_as_the_model_says() -> None:
    table = points("vlp16_incidence", 5)
    floor = table[(table["surface"] == "floor") & (table["incidence_rad"] > 1.0)]
    sigma = np.hypot(0.014, 0.010 + (0.1 * floor["incidence_rad"]) ** 2)
    assert (floor["range_error_m"] / sigma).std() == pytest.approx(1, abs=0.08)


def test_a_surface_keeps_at_most_so_many_points() -> None:
    table = points("none", 1, keep=500)
    assert table["surface"].value_counts().to_dict() == dict.fromkeys(POINT_SURFACES, 500)

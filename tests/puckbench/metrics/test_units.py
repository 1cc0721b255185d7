"""Distortions in metres, by hand."""

import pytest

from puckbench.metrics.units import distortion_in_metres, in_square_millimetres


def test_squared_units_become_metres_by_their_root() -> None:
    """At 50 units per metre, a squared error of 25 is one of 5 units, or of 0.1 m."""
    values = {
        "truth_d2_mse": 25.0,
        "hausdorff_point": 10.0,
        "hausdorff_plane": 5.0,
        "truth_q99_point": 2.5,
        "cd_point": 1.0,
    }
    assert distortion_in_metres(values, 50.0) == pytest.approx(
        {
            "truth_d2_rms_m": 0.1,
            "hausdorff_point_m": 0.2,
            "hausdorff_plane_m": 0.1,
            "truth_q99_point_m": 0.05,
        }
    )


def test_squared_metres_become_squared_millimetres() -> None:
    """A root mean square error of 5 mm is one of 25 mm^2."""
    values = {"d1_mse": 0.005**2, "d2_mse": 1e-6, "cd_point": 1.0}
    assert in_square_millimetres(values) == pytest.approx({"d1_mm2": 25, "d2_mm2": 1})

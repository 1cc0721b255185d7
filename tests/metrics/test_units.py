"""Distortions in metres, by hand."""

import pytest

from puckbench.metrics.units import in_metres


def test_squared_units_become_metres_by_their_root() -> None:
    """At 50 units per metre, a squared error of 25 is one of 5 units, or of 0.1 m."""
    values = {
        "truth_d2_mse": 25.0,
        "hausdorff_point": 10.0,
        "hausdorff_plane": 5.0,
        "cd_point": 1.0,
    }
    assert in_metres(values, 50.0) == pytest.approx(
        {"truth_d2_rms_m": 0.1, "hausdorff_point_m": 0.2, "hausdorff_plane_m": 0.1}
    )

"""The page on metrics names every measure of a sensor's returns, and the peaks of PSNRs."""

from pathlib import Path

import numpy as np

from puckbench.metrics.default_peak import PEAK_M
from puckbench.metrics.sensor_metrics import range_errors_of_points, real_time_metrics
from puckbench.metrics.units import in_square_millimetres

PAGE = (Path(__file__).parents[3] / "docs" / "explanation" / "metrics.md").read_text("utf-8")


def test_measures_of_returns_are_explained() -> None:
    row = {"bytes": 1, "encode_s": 1.0, "decode_s": 1.0}
    points = np.ones((2, 3))
    columns = [
        *range_errors_of_points(points, points),
        *real_time_metrics({"turns": 1, "seconds": 0.1}, row),
        *in_square_millimetres({"d1_mse": 1.0, "d2_mse": 1.0}),
    ]
    assert len(columns) == 11
    assert [name for name in columns if f"`{name}`" not in PAGE] == []


def test_the_peak_of_clouds_in_metres_is_the_one_that_is_used() -> None:
    assert f"metric clouds {PEAK_M:g} m" in PAGE

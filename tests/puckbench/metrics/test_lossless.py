"""Errors of single precision are no errors; those of coding are."""

import numpy as np
import pandas as pd
import pytest

from pointkit.geometry.cloud import PointCloud
from puckbench.metrics.cloud_metrics import geometry_metrics
from puckbench.metrics.lossless import lossless_rows, rounding, with_lossless_best, without_lossless

METRIC = {"size": 0, "scale": 1.0, "peak": 30.0, "offset": [0.0, 0, 0]}


def scan(count: int = 2000) -> np.ndarray:
    """Points on a grid of 1 mm, as KITTI's files have them, up to 80 m away."""
    rng = np.random.default_rng(1)
    return np.unique(np.rint(rng.uniform(-80, 80, (count, 3)) * 1000), axis=0) / 1000


def test_a_grid_that_comes_back_in_single_precision_is_lossless() -> None:
    points = scan()
    stored = PointCloud(points.astype(np.float32).astype(float), about=METRIC)
    steps = np.rint(stored.xyz / 0.001).astype(np.float32)
    decoded = (steps * np.float32(0.001)).astype(float)
    assert 0 < np.abs(decoded - stored.xyz).max() < 1e-4
    values = geometry_metrics(stored, decoded)
    assert values["lossless"] is True
    assert values["d1_mse"] == values["d1_rms_m"] == values["hausdorff_point"] == 0
    assert values["points_a"] == len(points)
    assert not [name for name in values if "psnr" in name]
    assert values["peak"] == 30


@pytest.mark.parametrize("step", [0.001, 0.002, 0.01])
def test_a_grid_that_is_shifted_by_half_a_step_is_not(step: float) -> None:
    points = scan()
    decoded = (np.floor(points / step) + 0.5) * step
    values = geometry_metrics(PointCloud(points, about=METRIC), decoded)
    assert values["lossless"] is False
    assert values["d1_psnr"] == pytest.approx(10 * np.log10(3 * 30**2 / values["d1_mse"]))


def test_a_lost_point_is_a_loss() -> None:
    points = scan()
    assert geometry_metrics(PointCloud(points, about=METRIC), points[1:])["lossless"] is False


def test_the_limit_follows_the_coordinates_up_to_a_tenth_of_a_millimetre() -> None:
    """At 64 m a unit in the last place of single precision is 2^-17 m, of which four count."""
    assert rounding(PointCloud(np.array([[0.0, -64, 0]]))) == pytest.approx(4 * 2.0**-17)
    spacing = float(np.spacing(np.float32(64)))
    assert rounding(PointCloud(np.array([[64.0, 0, 0]]))) == 4 * spacing
    assert rounding(PointCloud(np.full((1, 3), 5000.0))) == 1e-4
    scaled = PointCloud(np.full((1, 3), 1023.0), about={"size": 1024, "scale": 0.01})
    assert rounding(scaled) == 1023 * 2.0**-21


def test_rows_of_older_runs_are_judged_by_their_errors() -> None:
    table = pd.DataFrame({"hausdorff_point": [0.0, 1e-6, 0.01], "diameter": 100.0})
    assert lossless_rows(table).tolist() == [True, True, False]
    assert lossless_rows(table.assign(lossless=[None, False, True])).tolist() == [True, False, True]
    assert lossless_rows(pd.DataFrame({"d1_mse": [0.0, 1e-13]})).tolist() == [True, False]
    assert lossless_rows(pd.DataFrame({"bpp": [1.0]})).tolist() == [False]


def test_a_quantile_counts_a_lossless_cloud_as_the_best() -> None:
    table = pd.DataFrame({"d1_psnr": [60.0, 70, np.nan], "lossless": [False, False, True]})
    quantiles = without_lossless(with_lossless_best(table)[["d1_psnr"]].quantile([0.25, 0.5, 0.75]))
    assert quantiles["d1_psnr"].tolist()[:2] == [65, 70]
    assert np.isnan(quantiles["d1_psnr"].iloc[2])

"""Errors of reflectances and colours, against sums made by hand over all pairs."""

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.metrics.cloud_metrics import attribute_metrics
from puckbench.metrics.reflectance import reflectance_distortion

LINE = np.array([[0.0, 0, 0], [2, 0, 0], [10, 0, 0]])


def _cloud(points: np.ndarray, values: object) -> PointCloud:
    return PointCloud(points, fields={"intensity": np.asarray(values)})


def test_the_worse_direction_between_nearest_neighbours_counts() -> None:
    """To the right: 0 -> mean(10, 30), 100 -> 100, 7 -> 100. Back: 10 -> 0, 30 -> 0, 100 -> 100."""
    decoded = (np.array([[0.0, 1, 0], [0, -1, 0], [3, 0, 0]]), np.array([10, 30, 100]))
    errors = reflectance_distortion((LINE, np.array([0, 100, 7])), decoded)
    assert errors["reflectance_mse"] == pytest.approx((20**2 + 93**2) / 3)
    assert errors["reflectance_max_error"] == 93
    assert errors["reflectance_peak"] == 255
    assert errors["reflectance_psnr"] == pytest.approx(10 * np.log10(255**2 * 3 / (400 + 8649)))
    assert errors["reflectance_lossless"] is False


def test_pairs_are_those_of_all_distances() -> None:
    random = np.random.default_rng(1)
    a, b = (
        random.integers(0, 9, (80, 3)).astype(float),
        random.integers(0, 9, (60, 3)).astype(float),
    )
    x, y = random.integers(0, 65536, 80), random.integers(0, 65536, 60)

    def one_way(p: np.ndarray, v: np.ndarray, q: np.ndarray, w: np.ndarray) -> np.ndarray:
        (p, v), (q, w) = ((np.unique(k, axis=0), u) for k, u in ((p, v), (q, w)))
        squared = ((p[:, None] - q) ** 2).sum(axis=2)
        near = squared == squared.min(axis=1, keepdims=True)
        return v - (near * w).sum(axis=1) / near.sum(axis=1)

    def merged(p: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array([v[(p == point).all(axis=1)].mean() for point in np.unique(p, axis=0)])

    x_means, y_means = merged(a, x), merged(b, y)
    ways = [one_way(a, x_means, b, y_means), one_way(b, y_means, a, x_means)]
    errors = reflectance_distortion((a, x), (b, y))
    assert errors["reflectance_mse"] == pytest.approx(max(np.mean(way**2) for way in ways))
    assert errors["reflectance_max_error"] == pytest.approx(max(np.abs(way).max() for way in ways))
    assert errors["reflectance_peak"] == 65535


def test_lossless_means_the_same_values_at_their_points() -> None:
    near = LINE + 0.4
    for points, values, geometry, expected in (
        (LINE, [1, 2, 3], {"lossless": True}, True),
        (LINE, [2, 1, 3], {"lossless": True}, False),
        (near, [1, 2, 3], {}, True),
        (near, [1, 2, 4], {}, False),
        (LINE[:2], [1, 2], {}, False),
    ):
        metrics = attribute_metrics(_cloud(LINE, [1, 2, 3]), _cloud(points, values), geometry)
        assert metrics["reflectance_lossless"] is expected
    twice = np.zeros((2, 3))  # a mean hides the values, which are others
    metrics = attribute_metrics(_cloud(twice, [1, 3]), _cloud(twice, [2, 2]), {"lossless": True})
    assert (metrics["reflectance_max_error"], metrics["reflectance_lossless"]) == (0, False)


def test_colours_have_a_largest_error() -> None:
    first, other = np.array([[0, 9, 0]] * 3, np.uint8), np.array([[0, 9, 4]] * 3, np.uint8)
    pair = PointCloud(LINE, colours=first), PointCloud(LINE, colours=other)
    metrics = attribute_metrics(*pair, {})
    assert (metrics["colour_max_error"], metrics["colour_lossless"]) == (4, False)
    same = attribute_metrics(pair[0], pair[0], {})
    assert (same["colour_max_error"], same["colour_lossless"]) == (0, True)


def test_fractions_and_negative_values_are_measured_and_others_refused() -> None:
    errors = reflectance_distortion((LINE, np.array([-1, 0.5, 0])), (LINE, np.zeros(3)), peak=1)
    assert errors["reflectance_mse"] == pytest.approx(1.25 / 3)
    assert errors["reflectance_psnr"] == pytest.approx(10 * np.log10(3 / 1.25))
    with pytest.raises(InputError, match="decoded cloud: 1 of 3 reflectances are not finite"):
        reflectance_distortion((LINE, np.zeros(3)), (LINE, np.array([0, np.nan, 0])))
    with pytest.raises(InputError, match="reference cloud: needs a reflectance for every point"):
        reflectance_distortion((LINE, np.zeros(2)), (LINE, np.zeros(3)))

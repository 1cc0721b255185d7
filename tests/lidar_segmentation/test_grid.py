"""What the network sees of a scan, against numbers worked out by hand and a plain loop."""

from __future__ import annotations

import numpy as np

from lidar_segmentation.grid import HEIGHTS, OFFSETS, GridShape, gridded, lowest_near

SHAPE = GridShape(cells=8, cell_m=1.0, bottom_m=-2.0, bin_m=1.0, bins=4, near_cells=3)
POINTS = np.array([[0.25, 0.5, -1.5], [0.75, 0.5, 0.6], [-3.5, 3.5, 9.0], [5.0, 0.0, 0.0]])


def test_cells_know_their_occupied_heights_and_lowest_and_highest_points() -> None:
    columns = gridded(POINTS, SHAPE).columns
    assert columns.shape == (4 + HEIGHTS, 8, 8)
    assert columns[:4, 4, 4].tolist() == [1, 0, 1, 0]  # row y, column x
    assert columns[:4, 7, 0].tolist() == [0, 0, 0, 1]  # above the top bin
    assert columns[:4].sum() == 3  # the fourth point is outside
    np.testing.assert_allclose(columns[4:, 4, 4] * 4, [-1.5, 0.6, -1.5], rtol=1e-6)
    np.testing.assert_allclose(columns[4:, 5, 5] * 4, [0, 0, -1.5])  # empty, but beside a point


def test_points_know_their_place_in_cell_and_bin() -> None:
    scan = gridded(POINTS, SHAPE)
    np.testing.assert_allclose(scan.places[0], [0.25 / 4, 0.5 / 4])
    first, _, _, outside = scan.features
    np.testing.assert_allclose(first[4:6], [0.25 - 0.5, 0.0])
    np.testing.assert_allclose(first[OFFSETS:], [1, 0, 0, 0])  # the middle of the lowest bin
    np.testing.assert_allclose(scan.features[1, OFFSETS:], [0, 0, 0.9, 0.1], atol=1e-6)
    np.testing.assert_allclose(scan.features[1, 1:4], [1.05, 1.05, 0], rtol=1e-6)
    assert (first[7], outside[7]) == (1, 0)
    assert np.abs(outside[1:4]).max() == 0


def test_order_and_repetition_of_points_change_nothing() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-5, 5, (500, 3))
    order = rng.permutation(500)
    one, other = gridded(points, SHAPE), gridded(points[order], SHAPE)
    assert np.array_equal(one.columns, other.columns)
    assert np.array_equal(one.features[order], other.features)
    assert np.array_equal(gridded(np.tile(points, (2, 1)), SHAPE).columns, one.columns)


def test_the_grid_can_be_elsewhere() -> None:
    moved = gridded(POINTS + np.array([10, -20, 0]), SHAPE, (10.0, -20.0))
    assert np.array_equal(moved.columns, gridded(POINTS, SHAPE).columns)
    np.testing.assert_allclose(moved.places, gridded(POINTS, SHAPE).places, atol=1e-6)


def test_the_lowest_point_near_is_that_of_a_plain_loop() -> None:
    image = np.random.default_rng(1).normal(size=(9, 7))
    image[2, 3] = np.inf
    found = lowest_near(image, 5)
    for row, column in np.ndindex(image.shape):
        window = image[max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3]
        assert found[row, column] == window.min()

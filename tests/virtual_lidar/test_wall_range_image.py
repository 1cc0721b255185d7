import numpy as np

from pointkit.lidar.return_table import ReturnTable
from virtual_lidar.walls.detection import (
    AZIMUTH_COLUMNS,
    RangeImage,
    largest_patch,
    widened,
    without_ends,
)


def image(*spans: tuple[int, int, int]) -> np.ndarray:
    """Cells of (laser, first column, last column) in an image of 16 lasers."""
    pixels = np.zeros((16, AZIMUTH_COLUMNS), dtype=bool)
    for laser, first, last in spans:
        pixels[laser, np.arange(first, last + 1) % AZIMUTH_COLUMNS] = True
    return pixels


def test_a_patch_across_the_seam_is_one() -> None:
    pixels = image((3, 350, 365), (4, 355, 361), (10, 100, 109))
    assert np.array_equal(largest_patch(pixels, pixels * 1.0), image((3, 350, 365), (4, 355, 361)))


def test_the_largest_patch_is_that_with_the_most_returns() -> None:
    pixels = image((3, 10, 30), (10, 100, 102))
    returns = np.where(image((10, 100, 102)), 50.0, 1.0) * pixels
    assert np.array_equal(largest_patch(pixels, returns), image((10, 100, 102)))


def test_a_gap_of_two_cells_is_bridged_and_one_of_three_is_not() -> None:
    near, far = image((3, 10, 30), (3, 33, 40)), image((3, 10, 30), (3, 34, 40))
    assert np.array_equal(largest_patch(near, near * 1.0), near)
    assert np.array_equal(largest_patch(far, far * 1.0), image((3, 10, 30)))


def test_no_cell_is_no_patch() -> None:
    assert not largest_patch(image(), image() * 1.0).any()


def test_widening_does_not_run_from_the_lowest_laser_to_the_highest() -> None:
    assert np.array_equal(widened(image((0, 0, 0))), image((0, -1, 1), (1, -1, 1)))


def test_the_ends_of_a_row_are_cut_off() -> None:
    assert np.array_equal(without_ends(image((3, 350, 365))), image((3, 351, 364)))


def test_returns_are_counted_by_laser_elevation_and_degree() -> None:
    columns = {
        "elevation": np.radians([-15.0, 1.0, 1.0, -15.0]),
        "azimuth": np.radians([0.5, 359.99, 359.2, 0.6]),
        "distance": np.ones(4),
    }
    pixels = RangeImage.of(ReturnTable(columns))
    counts = pixels.counts(np.array([True, True, True, False]))
    assert counts.shape == (2, AZIMUTH_COLUMNS)
    assert (counts[0, 0], counts[1, 359], counts.sum()) == (1, 2, 3)
    assert pixels.rows(counts > 1).tolist() == [False, True, True, False]
    assert pixels.laser_rank.tolist() == [0, 1, 1, 0]

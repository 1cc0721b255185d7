"""Region merging, and its effect on a stream."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from primitive_codec.decoder import read_patches
from primitive_codec.mesh_reconstruction import segment_leaves
from primitive_codec.mode_decision import encode
from primitive_codec.octree import moments_of
from primitive_codec.octree_arrays import Leaves
from primitive_codec.plane_coding import _extended, dequantise_plane, quantise_plane
from primitive_codec.region_merging import (
    MergeLimits,
    adjacent_leaves,
    merge_regions,
    region_moments,
)
from primitive_codec.settings import RATES, PrimitiveSettings

_RIGHT = float(np.cos(np.radians(45)))
_SHAPE = np.array([16, 16, 16])


def _square(x: float, height: float = 0.0) -> np.ndarray:
    """Moments (10,) of 100 points of a square of 10 from x on, at a height."""
    across, along = np.meshgrid(np.arange(10) + 0.5, np.arange(10) + 0.5)
    xyz = np.stack([x + across.ravel(), along.ravel(), np.full(100, height)], axis=1)
    return np.asarray(moments_of(xyz).sum(axis=0))


def _upright(x: float) -> np.ndarray:
    """Moments of a square at x, upright."""
    across, along = np.meshgrid(np.arange(10) + 0.5, np.arange(10) + 0.5)
    return np.asarray(
        moments_of(np.stack([np.full(100, x), across.ravel(), along.ravel()], axis=1)).sum(axis=0)
    )


def _row(*pieces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Moments of pieces, each beside the next."""
    numbers = np.arange(len(pieces))
    return np.array(pieces), np.column_stack([numbers[:-1], numbers[1:]])


def test_coplanar_leaves_are_merged_and_orthogonal_ones_are_not() -> None:
    regions = merge_regions(
        *_row(_square(0), _square(10), _upright(20)), MergeLimits(1.0, 0.0, _RIGHT)
    )
    assert regions[0] == regions[1] != regions[2]


def test_leaves_that_are_not_adjacent_are_not_merged() -> None:
    moments, _ = _row(_square(0), _square(10))
    assert (
        len(set(merge_regions(moments, np.empty((0, 2), np.int64), MergeLimits(1e9, 1e9, 0.0))))
        == 2
    )


@pytest.mark.parametrize(("step", "one"), [(1.0, True), (1.5, False)])
def test_a_merge_adds_no_more_squared_distance_than_the_limits_allow(
    step: float, one: bool
) -> None:
    # 200 points lie step / 2 off the middle height. The correlation of a step and a line is the
    # root of 3 / 4, so that the tilted plane of both squares leaves a quarter of the squares.
    moments, pairs = _row(_square(0), _square(10, step))
    added = 200 * step**2 / 4 / 4
    assert (added < 15) == one
    assert (len(set(merge_regions(moments, pairs, MergeLimits(15.0, 0.0, 0.0)))) == 1) == one
    assert (len(set(merge_regions(moments, pairs, MergeLimits(0.0, 0.15, 0.0)))) == 1) == one


def test_the_pair_of_least_cost_is_merged_first() -> None:
    heights = (0.0, 1.0, 1.2)
    pieces = [_square(10 * k, height) for k, height in enumerate(heights)]
    regions = merge_regions(*_row(*pieces), MergeLimits(10.0, 0.0, 0.0))
    assert regions[1] == regions[2] != regions[0]


def _leaves(*cubes: tuple[tuple[int, int, int], int]) -> Leaves:
    corner, side = (np.array(part, np.int64) for part in zip(*cubes, strict=True))
    counts = np.array([len(side), 0])
    return Leaves(corner, side, np.zeros(len(side), np.int64), np.empty((0, 4)), counts)


@pytest.mark.parametrize("scale", [1, 4])
def test_leaves_are_adjacent_by_faces_edges_and_corners(scale: int) -> None:
    cubes = _leaves(((0, 0, 0), 4), ((4, 0, 0), 2), ((4, 4, 4), 1), ((6, 0, 2), 1))
    leaves = cubes._replace(corner=scale * cubes.corner, side=scale * cubes.side)
    assert {tuple(pair) for pair in adjacent_leaves(leaves, scale * _SHAPE)} == {
        (0, 1),
        (0, 2),
        (1, 3),
    }


def test_adjacency_of_large_leaves_takes_no_more_memory_than_their_grid() -> None:
    # A flat cloud's: cubes of half its extent stick out of it, beside one of a single cell.
    leaves = _leaves(((0, 0, 0), 4096), ((4096, 0, 0), 4096), ((4096, 4096, 0), 1))
    pairs = adjacent_leaves(leaves, np.array([4097, 4097, 1]))
    assert {tuple(pair) for pair in pairs} == {(0, 1), (0, 2), (1, 2)}


@given(st.sets(st.tuples(*3 * [st.integers(0, 3)]), min_size=1), st.data())
def test_adjacent_leaves_are_those_less_than_a_cell_apart(
    places: set[tuple[int, int, int]], data: st.DataObject
) -> None:
    # Cubes of side 1, 2 or 4 at the corners of cells of side 4.
    sides = [data.draw(st.sampled_from([1, 2, 4])) for _ in places]
    cubes = [((4 * x, 4 * y, 4 * z), s) for (x, y, z), s in zip(places, sides, strict=True)]
    lows = np.array([low for low, _ in cubes])
    highs = lows + np.array(sides)[:, None]
    beside = [
        (i, j)
        for i in range(len(cubes))
        for j in range(i + 1, len(cubes))
        if (lows[i] <= highs[j]).all() and (lows[j] <= highs[i]).all()
    ]
    assert sorted(tuple(pair) for pair in adjacent_leaves(_leaves(*cubes), _SHAPE)) == beside


def test_leaves_of_a_region_have_its_moments() -> None:
    leaves = _leaves(((0, 0, 0), 8), ((8, 0, 0), 8), ((0, 8, 8), 8))
    moments = np.array([_square(0), _square(10), _upright(0)])
    result = region_moments(moments, leaves, _SHAPE, MergeLimits(1.0, 0.0, _RIGHT))
    np.testing.assert_allclose(result, moments[[0, 0, 2]] + moments[[1, 1, 2]] * [[1], [1], [0]])


def test_a_plane_of_larger_reach_fits_farther_off() -> None:
    normal = np.array([0.1234, -0.0567, 1.0])
    normal /= np.linalg.norm(normal)
    plane = np.array([*normal, 20.0])
    far = np.array([200.0, 150.0])
    off = []
    for larger in range(5):
        cube = _extended((np.full(3, 16.0), 4.0, 1.0), larger)
        numbers, result = np.zeros(4, np.int64), np.empty(4)
        quantise_plane(plane, cube, numbers)
        dequantise_plane(numbers, cube, result)
        heights = [(p[3] - p[:2] @ far) / p[2] for p in (plane, result)]
        off.append(abs(heights[0] - heights[1]))
    # Half a step of height and of slopes: the slopes' step is that of a side 2^larger as long.
    steps = 2.0 ** (-0.5 * np.arange(5))
    assert (np.array(off) <= steps / 2 * (1 + (184 + 134) / (4 * 2.0 ** np.arange(5)))).all()
    assert off[4] < off[0] / 8


def test_one_plane_serves_a_noisy_wall() -> None:
    rng = np.random.default_rng(3)
    across = rng.random((60_000, 2)) * [1000, 700]
    height = across @ [0.21, -0.13] + rng.normal(0, 1.3, len(across))
    points = np.column_stack([across, height])
    patches = read_patches(encode(points, PrimitiveSettings(**RATES["r5"])))
    leaves, planes = patches.octree.leaves.counts
    assert planes <= 3 < leaves
    assert len(set(segment_leaves(patches))) == 1

"""Firings without a return among the points of a cloud."""

import numpy as np
import pytest

from cloud_files.missing_returns import missing_firings, missing_returns

RNG = np.random.default_rng(4)


def with_zeros(points: int, zeros: int, copies: int = 1) -> np.ndarray:
    """Points, each repeated, and some at the origin."""
    return np.vstack([np.repeat(RNG.random((points, 3)) + 1, copies, axis=0), np.zeros((zeros, 3))])


@pytest.mark.parametrize(
    ("points", "zeros", "copies", "found"),
    [
        (10, 3, 1, True),
        (10, 2, 1, False),  # two may be a point that is there twice
        (2997, 3, 1, True),
        (2998, 3, 1, False),  # less than one in a thousand
        (10, 7, 3, True),
        (10, 6, 3, False),  # not more than twice as many as lie elsewhere together
        (0, 9, 1, False),
        (10, 0, 1, False),
    ],
)
def test_many_points_at_the_origin_are_missing_returns(
    points: int, zeros: int, copies: int, found: bool
) -> None:
    xyz = with_zeros(points, zeros, copies)
    missing = missing_returns(xyz)
    assert missing.sum() == (zeros if found else 0)
    assert not missing[: len(xyz) - zeros].any()


def test_a_coarsely_rounded_cloud_keeps_its_points() -> None:
    """Integers from 0 to 2: about forty points lie at each position."""
    xyz = RNG.integers(0, 3, (1000, 3)).astype(float)
    assert not missing_returns(xyz).any()


def test_every_pixel_at_the_origin_of_an_image_is_missing() -> None:
    assert missing_returns(with_zeros(9, 1), is_organised=True).tolist() == [False] * 9 + [True]
    assert not missing_returns(with_zeros(9, 1)).any()


def test_points_without_any_coordinate_are_missing() -> None:
    nan = np.nan
    xyz = np.array([(nan, nan, nan), (nan, 1, 1), (0, 0, nan), (np.inf,) * 3, (1, 2, 3)])
    for is_organised in (False, True):
        assert missing_returns(xyz, is_organised).tolist() == [True, False, False, False, False]


def firings(place: tuple[float, float, float], rings: int) -> tuple[np.ndarray, np.ndarray]:
    """Twenty distant points of twenty rings, and a position that some rings share."""
    around = np.linspace(0, 6, 20)
    far = np.column_stack([9 * np.cos(around), 9 * np.sin(around), np.zeros(20)])
    return np.vstack([far, np.tile(place, (rings, 1))]), np.append(np.arange(20), np.arange(rings))


@pytest.mark.parametrize(
    ("place", "rings", "found"),
    [
        ((0.3, 0.3, 0.1), 3, True),
        ((0.3, 0.3, 0.1), 2, False),
        ((0.1, 0.1, 0.1), 1, True),  # nearer than any return
        ((0.2, 0.0, 0.0), 1, True),
        ((0.2, 0.1, 0.0), 1, False),
        ((4.0, 0.0, 0.0), 3, True),
        ((3.9, 0.5, 0.5), 3, True),
        ((4.0, 0.5, 0.5), 3, False),  # no car is so fast
    ],
)
def test_a_position_that_several_rings_share_is_the_sensor(
    place: tuple[float, float, float], rings: int, found: bool
) -> None:
    xyz, ring = firings(place, rings)
    missing = missing_firings(xyz, ring)
    assert missing.tolist() == [False] * 20 + [found] * rings


def test_repeated_points_of_one_ring_are_returns() -> None:
    xyz, _ = firings((0.3, 0.3, 0.1), 5)
    assert not missing_firings(xyz, np.append(np.arange(20), np.zeros(5))).any()


def test_a_single_firing_near_a_shared_position_is_missing() -> None:
    xyz, ring = firings((0.3, 0.3, 0.1), 3)
    xyz, ring = np.vstack([xyz, [(0.3, 0.349, 0.1), (0.3, 0.351, 0.1)]]), np.append(ring, [7, 8])
    assert missing_firings(xyz, ring)[-2:].tolist() == [True, False]


def test_positions_are_equal_within_rounding() -> None:
    xyz, ring = firings((0.3, 0.3, 0.1), 3)
    xyz[-1] += 2e-5
    assert missing_firings(xyz, ring)[-3:].all()
    xyz[0] = np.nan
    assert not missing_firings(xyz, ring)[0]

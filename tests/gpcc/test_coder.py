"""Whole streams: what goes in comes out, whatever the tools, and damage ends in one error."""

from contextlib import suppress
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gpcc.coder import PROFILES, GpccOptions, decode_geometry, encode_geometry
from gpcc.lossless import decode_voxels, encode_voxels
from pointkit.errors import InputError
from pointkit.models import parsed

OPTIONS = st.builds(
    GpccOptions,
    neighbour_avail_boundary_log2=st.integers(0, 8),
    adjacent_child_contextualization=st.booleans(),
    intra_pred_max_node_size_log2=st.sampled_from([0, 3, 6, 21]),
    planar=st.booleans(),
    planar_thresholds=st.tuples(*[st.integers(0, 127)] * 3),
    qtbt=st.booleans(),
    max_num_qtbt_before_ot=st.integers(0, 8),
    min_qtbt_size_log2=st.integers(0, 5),
    inferred_direct_coding_mode=st.integers(0, 3),
    planar_mode_idcm_use=st.integers(0, 32),
    joint_two_point_idcm=st.booleans(),
    merge_duplicates=st.booleans(),
    slice_max_points=st.sampled_from([7, 40, 1_100_000]),
)


@st.composite
def clouds(draw: Any) -> np.ndarray:
    """Points in up to 21 bits, near each other or not, equal or not, above and below zero."""
    bits = draw(st.integers(1, 21))
    base = draw(
        arrays(
            np.int64,
            st.tuples(st.integers(1, 60), st.just(3)),
            elements=st.integers(0, (1 << bits) - 1),
        )
    )
    repeats = draw(st.sampled_from([1, 1, 2, 13]))
    flat = draw(st.sampled_from([(1, 1, 1), (1, 1, 0), (0, 1, 0)]))
    return np.repeat(base * flat, repeats, axis=0) - draw(st.sampled_from([0, 1000, 1 << 20]))


def _sorted(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(points.T)]


@settings(max_examples=300)
@given(clouds(), OPTIONS)
def test_points_come_back(points: np.ndarray, options: GpccOptions) -> None:
    decoded = decode_geometry(encode_geometry(points, options))
    expected = np.unique(points, axis=0) if options.merge_duplicates else points
    assert np.array_equal(_sorted(decoded.points + np.array(decoded.origin)), _sorted(expected))


@pytest.mark.parametrize("profile", PROFILES)
def test_a_surface_comes_back(profile: str) -> None:
    random = np.random.default_rng(4)
    ball = random.normal(size=(20_000, 3))
    ball = np.rint(300 * ball / np.linalg.norm(ball, axis=1, keepdims=True)).astype(np.int64)
    tools = PROFILES[profile]
    expected = np.unique(ball, axis=0) if tools.merge_duplicates else ball
    decoded = decode_geometry(encode_geometry(ball, tools))
    assert np.array_equal(_sorted(decoded.positions()), _sorted(expected))


@pytest.mark.parametrize("scale", [1, 0.125, 0.375, Fraction(1, 3), 2.5, 1 / 65536])
def test_scale_and_origin_are_signalled(scale: Any) -> None:
    points = np.array([[0, 0, 0], [3, 9, 1]])
    decoded = decode_geometry(encode_geometry(points, GpccOptions(), scale, (-7, 0, 5)))
    assert decoded.scale == Fraction(scale).limit_denominator(1 << 16)
    assert decoded.origin == (-7, 0, 5)
    expected = (points + np.array([-7, 0, 5])) / float(scale)
    assert np.allclose(_sorted(decoded.positions()), _sorted(expected), rtol=1e-15)


def test_slices_hold_at_most_as_many_points_as_asked() -> None:
    points = np.random.default_rng(0).integers(0, 50, (3_000, 3))
    item = encode_geometry(points, GpccOptions())
    many = encode_geometry(points, GpccOptions(slice_max_points=400))
    assert len(many) > len(item)
    both = [np.unique(decode_geometry(s).positions(), axis=0) for s in (item, many)]
    assert np.array_equal(*both)
    assert len(decode_geometry(many).points) == len(both[0])


def test_adaptive_contexts_save_bits() -> None:
    """More of what the tools know of a surface makes it smaller, as published."""
    grid = np.indices((200, 200)).reshape(2, -1)
    wave = 40 + np.rint(25 * np.sin(grid[0] / 17) + 9 * np.cos(grid[1] / 11)).astype(np.int64)
    points = np.column_stack([*grid, wave])
    original = GpccOptions()
    sibling_occupancy = GpccOptions(neighbour_avail_boundary_log2=0)
    plain = GpccOptions(adjacent_child_contextualization=False)
    sizes = [len(encode_geometry(points, o)) for o in (original, plain, sibling_occupancy)]
    assert sizes == sorted(sizes)
    assert sizes[0] < 0.95 * sizes[1] < 0.95 * sizes[2]


@pytest.mark.parametrize(
    ("points", "fault"),
    [
        (np.empty((0, 3)), "no points"),
        (np.array([[0, 0, 0], [1 << 21, 0, 0]]), "more than 21 bits apart"),
    ],
    ids=["empty", "wide"],
)
def test_clouds_that_cannot_be_coded_are_refused(points: np.ndarray, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        encode_geometry(points, GpccOptions())


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("neighbour_avail_boundary_log2", 9),
        ("slice_max_points", 0),
        ("planar_thresholds", (0, 0, 128)),
    ],
)
def test_options_out_of_range_are_refused(option: str, value: Any) -> None:
    with pytest.raises(InputError, match=option):
        parsed(GpccOptions, {option: value}, "G-PCC")


STREAM = encode_geometry(
    np.random.default_rng(8).integers(0, 40, (300, 3)), PROFILES["ctc"], 0.5, (9, -9, 0)
)


@pytest.mark.parametrize("length", [0, 3, 14, 19, 28, 60, len(STREAM) - 1])
def test_truncated_streams_are_refused(length: int) -> None:
    with pytest.raises(InputError):
        decode_geometry(STREAM[:length])


def test_a_slice_that_claims_more_points_than_it_has_is_refused() -> None:
    with pytest.raises(InputError, match="fewer points"):
        decode_geometry(STREAM[:-3] + b"\xff\xff\xff")
    with pytest.raises(InputError, match="more points"):
        decode_geometry(STREAM[:-3] + b"\x00\x00\x10")


@settings(max_examples=300)
@given(st.integers(0, len(STREAM) - 1), st.binary(min_size=1, max_size=6), OPTIONS)
def test_damage_ends_in_one_error_or_points(
    place: int, bytes_: bytes, options: GpccOptions
) -> None:
    stream = encode_geometry(np.arange(90).reshape(30, 3) ** 2, options)
    place %= len(stream)
    damaged = stream[:place] + bytes_ + stream[place + len(bytes_) :]
    with suppress(InputError):
        assert np.isfinite(decode_geometry(damaged).positions()).all()


@settings(max_examples=100)
@given(clouds())
def test_voxels_come_back(points: np.ndarray) -> None:
    decoded = decode_voxels(encode_voxels(points))
    assert np.array_equal(_sorted(decoded), _sorted(np.unique(points, axis=0)))


def test_no_voxels_come_back() -> None:
    assert decode_voxels(encode_voxels(np.empty((0, 3), dtype=int))).shape == (0, 3)


def test_packed_voxels_have_few_header_bytes() -> None:
    points = np.random.default_rng(8).integers(0, 40, (300, 3))
    whole = encode_geometry(points, GpccOptions(qtbt=True))
    assert len(encode_voxels(points)) < len(whole) - 25


@settings(max_examples=200)
@given(st.integers(0, 400), st.binary(max_size=4))
def test_damaged_voxels_end_in_one_error_or_voxels(place: int, bytes_: bytes) -> None:
    stream = encode_voxels(np.arange(300).reshape(100, 3) ** 2 % 97)
    place %= len(stream)
    with suppress(InputError):
        assert decode_voxels(stream[:place] + bytes_).shape[1] == 3

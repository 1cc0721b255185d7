"""Coding of bits and numbers, planes from moments, occupancy maps, stream headers."""

import numpy as np
import pytest

from pointkit.coding.binary_coder import PAST_THE_END, POSITION, written
from pointkit.compiling import compiled
from pointkit.errors import InputError
from pointkit.geometry.moments import fit_plane, squared_distance
from primitive_codec.entropy import ContextCoder, code_bit, code_number, reader, writer
from primitive_codec.occupancy_map import optimise_occupancy_map
from primitive_codec.octree import build_octree, moments_of, prune_octree
from primitive_codec.plane_coding import dequantise_plane, quantise_plane
from primitive_codec.stream import (
    CLASSES,
    REVOLUTION_BYTES,
    DisplacementTable,
    SurfaceHeader,
    VoxelGrid,
    VoxelHeader,
    pack_surface,
    pack_voxels,
    unpack,
)


@compiled
def _code_bits(coder: ContextCoder, bits: np.ndarray, context: np.ndarray) -> np.ndarray:
    coded = np.zeros(len(bits), np.int64)
    for i in range(len(bits)):
        at = context[i]
        coded[i] = code_bit(coder, bits[i], 0, (at, 8 + at // 2, 12))
    return coded


@compiled
def _code_numbers(coder: ContextCoder, numbers: np.ndarray) -> np.ndarray:
    coded = np.zeros(len(numbers), np.int64)
    for i in range(len(numbers)):
        coded[i] = code_number(coder, numbers[i], 0, 0, 40)
    return coded


def _skewed(count: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Bits, their contexts and their entropy in bits."""
    rng = np.random.default_rng(0)
    context = rng.integers(0, 8, count)
    probability = (context + 0.5) / 40
    entropy = -(
        probability * np.log2(probability) + (1 - probability) * np.log2(1 - probability)
    ).sum()
    return (rng.random(count) < probability).astype(np.int64), context, entropy


def test_coded_bits_come_near_their_entropy() -> None:
    bits, context, entropy = _skewed(50_000)
    coder = writer(13, 1, 50_000)
    _code_bits(coder, bits, context)
    assert entropy * 0.99 < 8 * len(written(coder.bits)) < entropy * 1.03


def test_coded_bits_come_back() -> None:
    bits, context, _ = _skewed(5000)
    coder = writer(13, 1, 5000)
    _code_bits(coder, bits, context)
    decoded = _code_bits(reader(written(coder.bits), 13, 1), np.zeros_like(bits), context)
    assert np.array_equal(decoded, bits)


def test_a_reader_of_a_whole_stream_stays_near_its_end_even_where_it_ends_in_zeros() -> None:
    ones, context = np.ones(200_000, np.int64), np.zeros(200_000, np.int64)
    coder = writer(13, 1, 1000)
    _code_bits(coder, ones, context)
    assert coder.bits.registers[POSITION] > PAST_THE_END + 4
    stream = written(coder.bits)
    back = reader(stream, 13, 1)
    assert _code_bits(back, np.zeros_like(ones), context).all()
    assert back.bits.registers[POSITION] <= len(stream) + PAST_THE_END


def test_coded_numbers_come_back_large_ones_too() -> None:
    rng = np.random.default_rng(1)
    numbers = np.concatenate([rng.integers(-20, 20, 500), [0, 12, 13, -13, 4000, -30000]])
    coder = writer(80, 3, 10_000)
    _code_numbers(coder, numbers)
    decoded = _code_numbers(reader(written(coder.bits), 80, 3), np.zeros_like(numbers))
    assert np.array_equal(decoded, numbers)


def _scattered_plane() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    points = rng.normal(size=(200, 3)) * [3, 2, 0.1] @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return points + np.array([5.0, -4.0, 7.0]), rng.random(200) + 0.1


def test_planes_of_least_squares_are_those_of_the_singular_vectors() -> None:
    points, weights = _scattered_plane()
    plane = np.empty(4)
    error = fit_plane(moments_of(points, weights).sum(axis=0), plane)
    centre = np.average(points, axis=0, weights=weights)
    _, sizes, axes = np.linalg.svd((points - centre) * np.sqrt(weights)[:, None])
    assert abs(plane[:3] @ axes[2]) == pytest.approx(1)
    assert plane[3] == pytest.approx(plane[:3] @ centre)
    assert error == pytest.approx(sizes[2] ** 2)


def test_moments_give_the_squared_distances_to_any_plane() -> None:
    points, weights = _scattered_plane()
    plane = np.array([0.6, 0.0, 0.8, 1.5])
    expected = (weights * (points @ plane[:3] - plane[3]) ** 2).sum()
    distance = squared_distance(moments_of(points, weights).sum(axis=0), plane)
    assert distance == pytest.approx(expected)


def test_quantised_planes_stay_within_half_a_step_over_the_cube() -> None:
    rng = np.random.default_rng(3)
    cube = (np.array([40.0, 60.0, 20.0]), 8.0, 0.5)
    for _ in range(50):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        plane = np.array([*normal, normal @ (cube[0] + rng.uniform(-4, 4, 3))])
        numbers, dequantised = np.zeros(4, np.int64), np.empty(4)
        quantise_plane(plane, cube, numbers)
        dequantise_plane(numbers, cube, dequantised)
        axis = int(numbers[0])
        corner = cube[0] + 8 * rng.choice([-1, 1], 3)
        heights = []
        for each in (plane, dequantised):
            across = each[:3] @ corner - each[axis] * corner[axis]
            heights.append((each[3] - across) / each[axis])
        assert abs(heights[0] - heights[1]) <= 3 * 0.25 + 1e-9


def _floor_and_wall() -> tuple[np.ndarray, np.ndarray]:
    """Samples on cell centres of a floor (z = 4.5) and a wall (x = 28.5) in a cube of 32."""
    u, v = np.meshgrid(np.arange(32) + 0.5, np.arange(32) + 0.5)
    floor = np.column_stack([u.ravel(), v.ravel(), np.full(1024, 4.5)])
    wall = np.column_stack([np.full(1024, 28.5), u.ravel(), v.ravel()])
    normals = np.repeat([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], 1024, axis=0)
    return np.vstack([floor, wall]), normals


@pytest.mark.parametrize(
    ("lmbda", "is_one_leaf"), [(1e-6, False), (1e9, True)], ids=["low", "high"]
)
def test_lambda_decides_how_far_the_octree_is_split(lmbda: float, is_one_leaf: bool) -> None:
    xyz, normals = _floor_and_wall()
    levels = build_octree(xyz, normals, np.full(len(xyz), 1 / len(xyz)), 0.5, 5)
    prune_octree(levels, lmbda, 9.0, 5.0, 0, 5)
    assert levels[0].is_leaf[0] == is_one_leaf
    # Away from the edge a quarter of the cube is flat: one plane explains it at no cost.
    assert levels[1].is_leaf[0]


def test_optimised_occupancy_maps_lose_lone_columns_and_close_holes() -> None:
    gains = np.full((7, 7), -0.1)
    gains[:, :4] = 1.0
    gains[3, 2] = -0.1
    gains[1, 6] = 0.1
    bits = np.zeros((7, 7), np.uint8)
    optimise_occupancy_map(gains, 0.2, np.zeros((9, 9), np.int64), bits)
    expected = np.zeros((7, 7), np.uint8)
    expected[:, :4] = 1
    assert np.array_equal(bits, expected)


HEADER = SurfaceHeader(np.array([1.0, -2.0, 0.5]), 0.25, (30, 20, 10), 5, 4, 1, 16, 2048, 100)


PLACE = VoxelGrid(np.array([1.0, -2.0, 0.5]), 0.25)


@pytest.mark.parametrize("turn", [(0, 0, 0), (300, -20000, 5)])
@pytest.mark.parametrize("rounds", [b"", bytes(range(2 * REVOLUTION_BYTES))])
def test_headers_come_back(turn: tuple[int, int, int], rounds: bytes) -> None:
    header, bits = unpack(pack_surface(HEADER._replace(rotation=turn, revolutions=rounds), b"abc"))
    assert isinstance(header, SurfaceHeader)
    assert header[1:] == (*HEADER[1:-2], turn, rounds)
    assert np.array_equal(header.origin, HEADER.origin)
    assert bits == b"abc"


@pytest.mark.parametrize(
    "table", [None, DisplacementTable(2, np.arange(CLASSES, dtype=np.int8) - 12)]
)
def test_headers_of_voxels_come_back(table: DisplacementTable | None) -> None:
    header, bits = unpack(pack_voxels(PLACE, table, b"abc"))
    assert isinstance(header, VoxelHeader)
    assert np.array_equal(header.grid.origin, PLACE.origin)
    assert header.grid.cell_size == PLACE.cell_size
    assert bits == b"abc"
    if table is None:
        assert header.displacements is None
    else:
        assert header.displacements is not None
        assert header.displacements.block_size == table.block_size
        assert np.array_equal(header.displacements.factors, table.factors)


@pytest.mark.parametrize("block", [3, 200])
def test_displacement_tables_of_unknown_block_sizes_are_refused(block: int) -> None:
    with pytest.raises(InputError, match="damaged"):
        unpack(pack_voxels(PLACE, DisplacementTable(block, np.zeros(CLASSES, np.int8)), b"abc"))


def test_streams_of_another_version_are_refused() -> None:
    stream = bytearray(pack_voxels(PLACE, None, b""))
    stream[4] = 1
    with pytest.raises(InputError, match="version 1, this codec reads 5 and 6"):
        unpack(bytes(stream))


@pytest.mark.parametrize(
    "change",
    [
        {"shape": (60000, 60000, 1)},
        {"shape": (0, 1, 1)},
        {"depth": 4},
        {"finest_leaf_level": 6},
        {"coarsest_leaf_level": 5},
        {"point_spacing": 0},
        {"leaf_capacity": 1 << 30},
        {"cell_size": 0.0},
        {"origin": np.array([np.inf, 0.0, 0.0])},
    ],
    ids=str,
)
def test_headers_that_make_no_sense_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(InputError, match="damaged"):
        unpack(pack_surface(HEADER._replace(**change), b"abc"))


@pytest.mark.parametrize("stream", [b"", b"PBPR", b"draco", pack_voxels(PLACE, None, b"")[:-1]])
def test_foreign_and_truncated_streams_are_refused(stream: bytes) -> None:
    with pytest.raises(InputError):
        unpack(stream)

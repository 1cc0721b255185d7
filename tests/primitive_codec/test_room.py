"""The codec on a room whose true surface is known, noisy and clean."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointkit.errors import InputError
from primitive_codec import RATES, PrimitiveSettings, decode, decode_mesh, decode_surface, encode
from primitive_codec.manhattan_frame import rotation_matrix
from primitive_codec.preparation import estimate_noise, prepare
from primitive_codec.smoothing import downsample, smooth_samples
from primitive_codec.stream import VoxelHeader, pack_surface, pack_voxels, unpack
from primitive_codec.surface_mode import SurfaceMode, encode_surface
from primitive_codec.voxel_mode import VoxelSearch

SIZE = np.array([1023.0, 700.0, 500.0])
NOISE = 2.5


def _room(points: int = 60_000, noise: float = NOISE) -> np.ndarray:
    """Points on the six sides of a box in the cube of 1023 units, noisy along the normals."""
    rng = np.random.default_rng(4)
    areas = np.repeat([SIZE[1] * SIZE[2], SIZE[0] * SIZE[2], SIZE[0] * SIZE[1]], 2)
    side = rng.choice(6, points, p=areas / areas.sum())
    xyz = rng.random((points, 3)) * SIZE
    rows, axis = np.arange(points), side // 2
    xyz[rows, axis] = (side % 2) * SIZE[axis] + rng.normal(0, noise, points)
    return xyz


def _to_truth(points: np.ndarray) -> np.ndarray:
    """Distance of each point to the nearest side of the box, seen as planes."""
    return np.minimum(np.abs(points), np.abs(points - SIZE)).min(axis=1)


def _encoded(points: np.ndarray, rate: str) -> bytes:
    return encode(points, PrimitiveSettings(**RATES[rate]))


@cache
def _small_stream(rate: str) -> bytes:
    """A stream of voxels for r8, else of surfaces."""
    if rate == "r8":
        return VoxelSearch(_room(3000)).encode_to_budget(1300, max_voxel_size=4).stream
    coded = encode_surface(
        prepare(_room(3000), PrimitiveSettings(min_leaf_size=32, column_size=16, lmbda=600)),
        SurfaceMode(),
    )
    assert coded is not None
    return coded.stream


@pytest.mark.parametrize("rate", ["r3", "r5"])
def test_decoded_points_are_nearer_to_the_truth_than_the_noisy_ones(rate: str) -> None:
    points = _room()
    stream = _encoded(points, rate)
    decoded = decode(stream)
    assert np.mean(_to_truth(decoded) ** 2) < 0.3 * np.mean(_to_truth(points) ** 2)
    assert 8 * len(stream) / len(points) < 0.5


@pytest.mark.parametrize("rate", ["r3", "r5"])
def test_the_whole_surface_comes_back(rate: str) -> None:
    from scipy.spatial import cKDTree

    points = _room()
    decoded = decode(_encoded(points, rate))
    farthest = np.quantile(cKDTree(decoded).query(points)[0], 0.99)
    assert farthest < 24


def test_decoded_normals_are_those_of_the_sides() -> None:
    decoded = decode_surface(_encoded(_room(), "r4"))
    assert np.allclose(np.linalg.norm(decoded.normals, axis=1), 1)
    inner = np.sort(np.minimum(decoded.xyz, SIZE - decoded.xyz), axis=1)[:, 1] > 40
    assert np.quantile(np.abs(decoded.normals[inner]).max(axis=1), 0.05) > 0.999


def test_the_sides_of_a_box_are_six_segments() -> None:
    mesh = decode_mesh(_encoded(_room(), "r4"))
    assert mesh.labels is not None
    areas = np.bincount(mesh.labels.object_id, mesh.areas())
    largest = np.sort(areas)[::-1]
    sides = np.repeat([1023 * 700, 1023 * 500, 700 * 500], 2)
    assert largest[:6] == pytest.approx(sides, rel=0.15)
    assert largest[6:].sum() < 0.05 * areas.sum()


def test_voxels_have_no_mesh() -> None:
    with pytest.raises(InputError, match="voxels, not planes"):
        decode_mesh(VoxelSearch(_room(1000)).encode_to_budget(400).stream)


def test_the_highest_rate_reproduces_small_clouds_too() -> None:
    points = _room(1000)
    decoded = decode(_encoded(points, "r8"))
    away = np.linalg.norm(points[:, None] - decoded[None], axis=2).min(axis=1)
    assert away.max() < 4


def test_a_rotated_room_takes_no_more_bits() -> None:
    points = _room(20_000)
    turned = points @ rotation_matrix((1500, -4000, 7000)).T
    bits, bits_turned = (len(_encoded(xyz, "r3")) for xyz in (points, turned))
    assert bits_turned < 1.15 * bits


def test_flat_rooms_need_few_planes() -> None:
    mesh = decode_mesh(_encoded(_room(), "r3"))
    assert mesh.labels is not None
    assert len(mesh.labels.primitives) < 60


@pytest.mark.parametrize("noise", [0.0, 1.0, 2.5])
def test_the_noise_is_found(noise: float) -> None:
    # Cells whose faces lie in the surface cut the noise in half: the room is moved off them.
    assert estimate_noise(_room(200_000, noise) + 10, 40.0) == pytest.approx(
        noise, rel=0.15, abs=0.01
    )


def test_smoothing_moves_samples_onto_the_surface() -> None:
    rng = np.random.default_rng(6)
    points = np.column_stack([rng.random((40_000, 2)) * 200, 50 + rng.normal(0, 2, 40_000)])
    samples = downsample(points, 6.0)
    xyz, normals = smooth_samples(samples, 6.0, 25.0, 12.0)
    assert np.std(xyz[:, 2] - 50) < 0.25 * np.std(samples.xyz[:, 2] - 50)
    assert np.quantile(np.abs(normals[:, 2]), 0.05) > 0.98


def test_smoothing_keeps_an_edge() -> None:
    # One pass, whose neighbours are those of both walls, leaves 6.2 squared units there.
    rng = np.random.default_rng(0)
    along, across = rng.random((2, 40_000)) * 200
    noise, level = rng.normal(0, 1.3, len(along)), np.arange(len(along)) % 2 == 0
    floor, wall = (along, across, noise), (noise, across, along)
    points = np.where(level[:, None], np.stack(floor, axis=1), np.stack(wall, axis=1)) + 300
    xyz = smooth_samples(downsample(points, 4.0), 4.0, 25.0, 8.5)[0] - 300
    near = np.maximum(xyz[:, 0], xyz[:, 2]) < 15
    assert np.count_nonzero(near) > 500
    assert np.mean(np.minimum(xyz[near, 0] ** 2, xyz[near, 2] ** 2)) < 0.5


@settings(max_examples=120)
@given(data=st.data(), rate=st.sampled_from(["r2", "r8"]))
def test_damage_behind_a_right_check_ends_in_an_error_or_points(
    data: st.DataObject, rate: str
) -> None:
    header, bits = unpack(_small_stream(rate))
    damaged = bytearray(bits[: data.draw(st.integers(0, len(bits)))])
    for _ in range(data.draw(st.integers(0, 4))):
        if damaged:
            damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    if isinstance(header, VoxelHeader):
        stream = pack_voxels(header.grid, header.displacements, bytes(damaged))
    else:
        stream = pack_surface(header, bytes(damaged))
    try:
        decoded = decode(stream)
    except InputError:
        return
    assert np.isfinite(decoded).all()

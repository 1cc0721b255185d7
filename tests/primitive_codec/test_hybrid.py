"""Hybrid streams: layout, and reconstruction from a surface and voxels."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointkit.errors import InputError
from pointkit.measurement import NO_COST
from primitive_codec import hybrid_mode, mode_decision, voxel_mode
from primitive_codec.decoder import decode
from primitive_codec.distortion import Distortion, NearestOffsets
from primitive_codec.mesh_reconstruction import decode_mesh
from primitive_codec.mode_decision import SurfaceCache, _refined_budget, encode
from primitive_codec.preparation import prepare
from primitive_codec.settings import RATES, PrimitiveSettings
from primitive_codec.stream import (
    CLASSES,
    HybridHeader,
    VoxelHeader,
    pack_hybrid,
    pack_voxels,
    unpack,
)
from primitive_codec.surface_mode import CodedSurface, SurfaceMode, encode_surface

NO_FACTORS = np.zeros(CLASSES, np.int8)
_NOTHING = NearestOffsets(np.zeros((1, 3)), np.zeros((1, 3)))
MOST_POINTS = hybrid_mode.HybridCriterion(
    nearest_offsets=lambda _: _NOTHING,
    measure=lambda xyz, _: Distortion(-len(xyz), 0.0, 0.0),
    cost=lambda result: result.point,
)


def _floor(noise: float = 0.0) -> np.ndarray:
    """Lines of points on a tilted floor: where on it they lie is what a surface leaves out."""
    rng = np.random.default_rng(5)
    xyz = np.column_stack([rng.random(20_000) * 1000, rng.integers(0, 25, 20_000) * 40.0])
    return np.column_stack([xyz, xyz @ [0.21, -0.13] + rng.normal(0, noise, len(xyz))])


@cache
def _surface(noise: float = 0.0) -> CodedSurface:
    cloud = prepare(_floor(noise), PrimitiveSettings(min_leaf_size=32, column_size=8, lmbda=30))
    coded = encode_surface(cloud, SurfaceMode())
    assert coded is not None
    return coded


@cache
def _hybrid(noise: float = 0.0) -> bytes:
    points = _floor(noise)
    budget = len(_surface(noise).stream) + 3000
    result = hybrid_mode.encode(
        voxel_mode.VoxelSearch(points), _surface(noise), budget, 1023, MOST_POINTS
    )
    assert result is not None
    return result.stream


def test_a_hybrid_comes_back() -> None:
    factors = np.arange(CLASSES, dtype=np.int8) - 12
    header, bits = unpack(pack_hybrid(HybridHeader(7, factors, b"surface", b"voxels")))
    assert isinstance(header, HybridHeader)
    assert (header.keep_distance, header.surface, header.voxels, bits) == (
        7,
        b"surface",
        b"voxels",
        b"",
    )
    assert np.array_equal(header.factors, factors)


def test_streams_of_one_kind_keep_their_version() -> None:
    versions = [stream[4] for stream in (_surface().stream, _voxels(_hybrid()), _hybrid())]
    assert versions == [5, 5, 6]


def _voxels(stream: bytes) -> bytes:
    header, _ = unpack(stream)
    assert isinstance(header, HybridHeader)
    return header.voxels


def test_voxels_move_onto_the_surface_of_a_clean_scan() -> None:
    surface, voxels = _surface(), _voxels(_hybrid())
    heights = [xyz[:, 2] - xyz[:, :2] @ [0.21, -0.13] for xyz in _parts(surface, voxels)]
    assert np.mean(heights[0] ** 2) < 0.1 * np.mean(heights[1] ** 2)


def _parts(surface: CodedSurface, voxels: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Points of the voxels of `_hybrid` beside its surface, and of the same voxels alone."""
    header, _ = unpack(_hybrid())
    assert isinstance(header, HybridHeader)
    moved = decode(pack_hybrid(header._replace(keep_distance=0)))
    alone = decode(voxels)
    assert len(moved) == len(alone)
    return moved, alone


def test_the_surface_keeps_its_points_in_occupied_voxels() -> None:
    header, _ = unpack(_hybrid())
    assert isinstance(header, HybridHeader)
    part, _ = unpack(header.voxels)
    assert isinstance(part, VoxelHeader)
    count = len(decode(header.voxels))
    kept = decode(_hybrid())[count:]
    assert len(kept) > 100
    cells = voxel_mode.voxelise(_floor(), part.grid).cells
    occupied = {tuple(cell) for cell in cells.tolist()}
    nearest = np.rint((kept - part.grid.origin) / part.grid.cell_size).astype(int)
    assert {tuple(cell) for cell in nearest.tolist()} <= occupied


def test_noise_is_followed_less_than_by_voxels_of_as_many_bytes() -> None:
    points = _floor(2.5)
    voxels = voxel_mode.VoxelSearch(points).encode_to_budget(len(_hybrid(2.5))).stream
    errors = [_mean_square(decode(stream)) for stream in (_hybrid(2.5), voxels)]
    assert errors[0] < 0.95 * errors[1]


def _mean_square(xyz: np.ndarray) -> float:
    return float(np.mean((xyz[:, 2] - xyz[:, :2] @ [0.21, -0.13]) ** 2))


def test_a_hybrid_has_the_mesh_of_its_surface() -> None:
    result, expected = decode_mesh(_hybrid()), decode_mesh(_surface().stream)
    assert np.array_equal(result.vertices, expected.vertices)


def test_a_surface_that_takes_the_whole_budget_leaves_no_voxels() -> None:
    budget = len(_surface().stream)
    assert (
        hybrid_mode.encode(voxel_mode.VoxelSearch(_floor()), _surface(), budget, 1023, MOST_POINTS)
        is None
    )


def test_bits_grow_from_the_surface_to_the_highest_rate_in_equal_ratios() -> None:
    points = _floor()
    for size, most in ((8, 3.5 * len(points) / 8), (0.1, 4.5 * len(points) / 8)):
        rates = (PrimitiveSettings(max_voxel_size=size, refinement=k / 3) for k in range(4))
        budgets = [_refined_budget(voxel_mode.VoxelSearch(points), 1000, rate)[0] for rate in rates]
        assert budgets[0] == 1000
        assert budgets[3] >= int(most)
        steps = np.diff(np.log(budgets))
        assert steps[1] == pytest.approx(steps[0], rel=0.01)
        assert steps[2] <= 1.01 * steps[1]


@pytest.mark.parametrize("part", ["surface", "voxels"])
def test_parts_of_another_kind_are_refused(part: str) -> None:
    header = HybridHeader(8, NO_FACTORS, _surface().stream, _voxels(_hybrid()))
    for other in (_hybrid(), header.voxels if part == "surface" else header.surface, b""):
        changed: dict[str, Any] = {part: other}
        with pytest.raises(InputError):
            decode(pack_hybrid(header._replace(**changed)))


@pytest.mark.parametrize(
    "change",
    [{"keep_distance": 9}, {"factors": NO_FACTORS[1:], "surface": b"", "voxels": b""}],
    ids=str,
)
def test_headers_that_make_no_sense_are_refused(change: dict[str, Any]) -> None:
    header = HybridHeader(8, NO_FACTORS, _surface().stream, _voxels(_hybrid()))
    with pytest.raises(InputError, match="damaged"):
        unpack(pack_hybrid(header._replace(**change)))


@pytest.mark.parametrize(("origin", "size"), [(1e30, 1.0), (0.0, 1e-30), (-1e30, 1e30)])
def test_grids_that_lie_far_apart_decode_to_finite_points(origin: float, size: float) -> None:
    header, bits = unpack(_voxels(_hybrid()))
    assert isinstance(header, VoxelHeader)
    place = header.grid._replace(origin=np.full(3, origin), cell_size=size)
    voxels = pack_voxels(place, header.displacements, bits)
    stream = pack_hybrid(HybridHeader(8, NO_FACTORS + 127, _surface().stream, voxels))
    try:
        assert np.isfinite(decode(stream)).all()
    except InputError:
        return


def test_a_surface_of_coinciding_points_is_refused() -> None:
    """A search among a million equal points would take minutes."""
    header = HybridHeader(8, NO_FACTORS, _surface().stream, _voxels(_hybrid()))
    same = np.ones((1_000_000, 3))
    with pytest.raises(InputError, match="too far from its surface"):
        hybrid_mode.decode(header, same, same)


@settings(max_examples=60)
@given(data=st.data())
def test_damage_of_a_part_ends_in_an_error_or_points(data: st.DataObject) -> None:
    header, bits = unpack(_voxels(_hybrid()))
    assert isinstance(header, VoxelHeader)
    damaged = bytearray(bits[: data.draw(st.integers(0, len(bits)))])
    for _ in range(data.draw(st.integers(0, 4))):
        if damaged:
            damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    voxels = pack_voxels(header.grid, header.displacements, bytes(damaged))
    factors = np.array(data.draw(st.lists(st.integers(-128, 127), min_size=24, max_size=24)))
    whole = HybridHeader(
        data.draw(st.integers(0, 8)), factors.astype(np.int8), _surface().stream, voxels
    )
    try:
        assert np.isfinite(decode(pack_hybrid(whole))).all()
    except InputError:
        return


def test_more_voxels_than_a_hybrid_may_have_are_neither_coded_nor_decoded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stream = _hybrid()
    for module in (voxel_mode, hybrid_mode):
        monkeypatch.setattr(module, "MAX_HYBRID_VOXELS", 10)
    with pytest.raises(InputError):
        decode(stream)
    result = hybrid_mode.encode(
        voxel_mode.VoxelSearch(_floor()), _surface(), len(stream), 16.0, MOST_POINTS
    )
    assert result is None


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """An entry for each search for a surface."""
    searches: list[int] = []
    search = mode_decision._best_surface

    def counted(*args: Any) -> Any:
        searches.append(1)
        return search(*args)

    monkeypatch.setattr(mode_decision, "_best_surface", counted)
    return searches


def _encoded(points: np.ndarray, rate: str, cache: SurfaceCache | None = None) -> bytes:
    return encode(points, PrimitiveSettings(**RATES[rate]), cache)


def test_rates_that_differ_in_refinement_share_the_surface(searches: list[int]) -> None:
    points, cache, streams, saved = _floor(2.0), SurfaceCache(), {}, {}
    for rate in ("r5", "r6", "r8", "r5", "r4"):
        streams[rate] = _encoded(points, rate, cache)
        saved[rate] = cache.saved
    assert len(searches) == 3  # r5, again r5, and r4
    assert streams == {rate: _encoded(points, rate) for rate in streams}
    assert saved["r5"] == saved["r4"] == NO_COST
    assert min(saved["r6"]) > 0
    assert _encoded(points[::2], "r4", cache) == _encoded(points[::2], "r4")
    assert _encoded(points[::2], "r8", cache) == _encoded(points[::2], "r8")
    assert cache.saved == NO_COST  # another cloud, another surface


def test_without_a_cache_no_call_depends_on_earlier_ones(searches: list[int]) -> None:
    points = _floor(2.0)
    first = _encoded(points, "r6")
    _encoded(points[::2], "r6")
    assert _encoded(points, "r6") == first
    assert len(searches) == 3

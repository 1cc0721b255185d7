"""Surfaces of revolution: geometry, occupancy maps, detection, streams."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointkit.coding.binary_coder import written
from pointkit.errors import InputError
from primitive_codec.decoder import decode, decode_surface
from primitive_codec.entropy import reader, writer
from primitive_codec.mesh_reconstruction import decode_mesh
from primitive_codec.mode_decision import encode
from primitive_codec.preparation import prepare
from primitive_codec.revolution import (
    CONE,
    CONTEXTS,
    MIXERS,
    SPHERE,
    RevolutionSurface,
    UnrolledMap,
    code_unrolled_map,
    distance_to,
    is_representable,
    pack_parameters,
    reconstruct_columns,
    unpack_parameters,
)
from primitive_codec.revolution_occupancy import RevolutionCosts, fit_revolutions
from primitive_codec.settings import RATES, PrimitiveSettings
from primitive_codec.shape_detection import detect_revolutions
from primitive_codec.stream import (
    REVOLUTION_BYTES,
    SPACING_UNIT,
    SurfaceHeader,
    pack_surface,
    unpack,
)
from primitive_codec.surface_mode import SurfaceMode, encode_surface, revolution_candidates

R3 = PrimitiveSettings(**RATES["r3"])
AXIS = np.array([0.36, 0.48, 0.8])
CYLINDER = RevolutionSurface(CONE, np.array([40.0, 50.0, 30.0]), AXIS, 12.0, 0.0, -20, 40)
FRUSTUM = CYLINDER._replace(angle=0.3)
BALL = RevolutionSurface(
    SPHERE, np.array([40.0, 50.0, 30.0]), np.array([0.0, 0.0, 1.0]), 15.0, 0.0, -24, 48
)


@pytest.mark.parametrize("surface", [CYLINDER, FRUSTUM, BALL], ids=["cylinder", "cone", "sphere"])
def test_places_on_a_surface_have_their_coordinates(surface: RevolutionSurface) -> None:
    rng = np.random.default_rng(0)
    along, turn = rng.uniform(-18, 18, 300), rng.uniform(-3.1, 3.1, 300)
    xyz, normals = surface.points_at(along, turn)
    found_along, found_turn, distance, own_normals = surface.coordinates(xyz + 0.5 * normals)
    assert np.allclose(found_along, along)
    assert np.allclose(found_turn, turn)
    assert np.allclose(distance, 0.5)
    assert np.allclose(own_normals, normals)
    sine, cosine = np.sin(surface.angle), np.cos(surface.angle)
    beside = [distance_to(surface, sine, cosine, point)[0] for point in xyz + 0.5 * normals]
    assert np.allclose(beside, 0.5)


def test_points_of_a_cylinder_are_at_its_radius() -> None:
    bits = np.ones(CYLINDER.column_count(), np.uint8)
    xyz, _ = reconstruct_columns(UnrolledMap(CYLINDER, bits), SPACING_UNIT // 2)
    vector = xyz - CYLINDER.origin
    assert np.allclose(np.linalg.norm(np.cross(vector, AXIS), axis=1), 12.0)
    assert np.ptp(vector @ AXIS) == pytest.approx(39.5)
    assert len(xyz) == 4 * 40 * round(2 * np.pi * 12)


def test_the_columns_of_a_sphere_cover_its_area() -> None:
    assert BALL.column_count() == pytest.approx(4 * np.pi * 15**2, rel=0.02)


@pytest.mark.parametrize("surface", [CYLINDER, FRUSTUM, BALL], ids=["cylinder", "cone", "sphere"])
@pytest.mark.parametrize("flip", [1.0, -1.0])
def test_parameters_come_back_to_their_precision(surface: RevolutionSurface, flip: float) -> None:
    turned = surface._replace(
        axis=flip * surface.axis,
        angle=flip * surface.angle,
        first_row=surface.first_row if flip > 0 else -surface.first_row - surface.row_count,
    )
    (result,) = unpack_parameters(pack_parameters(turned))
    assert result.kind == surface.kind
    assert np.allclose(result.origin, surface.origin, atol=0.07)
    assert np.allclose(result.axis, surface.axis, atol=1e-4)
    assert result.radius == pytest.approx(surface.radius, abs=0.04)
    assert result.angle == pytest.approx(surface.angle, abs=1e-4)
    assert (result.first_row, result.row_count) == (surface.first_row, surface.row_count)


@pytest.mark.parametrize("place", [0, 11])
def test_impossible_parameters_of_surfaces_are_refused(place: int) -> None:
    damaged = bytearray(pack_parameters(CYLINDER))
    damaged[place : place + 2] = b"\xff\xff" if place == 0 else b"\0\0"
    with pytest.raises(InputError, match="damaged"):
        unpack_parameters(bytes(damaged))


def test_surfaces_too_large_are_refused() -> None:
    large = CYLINDER._replace(radius=4000.0, row_count=16000)
    with pytest.raises(InputError, match="too large"):
        unpack_parameters(pack_parameters(large))


def test_unrolled_occupancy_maps_come_back_in_few_bits() -> None:
    columns = FRUSTUM.columns_per_row()
    place = np.arange(columns.sum()) - np.repeat(np.cumsum(columns) - columns, columns)
    bits = (place < 0.4 * np.repeat(columns, columns)).astype(np.uint8)
    coder = writer(CONTEXTS, MIXERS, 10_000)
    code_unrolled_map(coder, columns, bits.copy())
    stream = written(coder.bits)
    result = np.zeros_like(bits)
    code_unrolled_map(reader(stream, CONTEXTS, MIXERS), columns, result)
    assert np.array_equal(result, bits)
    assert 8 * len(stream) < 0.15 * len(bits)


@pytest.mark.parametrize(
    "changes",
    [
        {"angle": 1.6},
        {"radius": 5000.0},
        {"radius": np.nan},
        {"origin": np.array([0.0, 0.0, 5000.0])},
        {"first_row": 40_000},
        {"radius": 4000.0, "row_count": 4000},
    ],
)
def test_surfaces_beyond_the_streams_number_ranges_are_not_representable(
    changes: dict[str, Any],
) -> None:
    assert is_representable(CYLINDER)
    assert not is_representable(CYLINDER._replace(**changes))


def test_surfaces_that_are_not_representable_are_skipped() -> None:
    prices = RevolutionCosts(20.0, 0.1, 100.0, 1.0, 2.0, 0.0)
    result = []
    for surface in (FRUSTUM, FRUSTUM._replace(angle=np.pi / 2 + 0.01)):
        along, turn = np.random.default_rng(3).uniform(-18, 18, (2, 4000))
        wraps, _ = fit_revolutions(
            [surface], *surface.points_at(along, turn), np.ones(4000), prices
        )
        result.append(len(wraps))
    assert result == [1, 0]


def _solids(count: int = 16_000, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals on a cylinder, a sphere and a cone, in units of the 1023 cube."""
    rng = np.random.default_rng(0)
    turn, up = rng.random(count // 2) * 2 * np.pi, rng.random(count // 2)
    out = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count // 2)])
    tube = 150 * out + np.column_stack([np.full((count // 2, 2), 200), 600 * up])
    ball = rng.normal(size=(count // 4, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    turn, down = rng.random(count // 4) * 2 * np.pi, np.sqrt(rng.random(count // 4))
    side = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count // 4)])
    hat = 140 * side * down[:, None] + [850, 200, 500] - down[:, None] * [0, 0, 400]
    slope = np.hypot(140, 400)
    normals = np.concatenate([out, ball, side * 400 / slope + [0, 0, 140 / slope]])
    xyz = np.concatenate([tube, 120 * ball + [600, 300, 300], hat])
    return xyz + rng.normal(0, 1, (len(xyz), 1)) * noise * normals, normals


def test_a_cylinder_a_sphere_and_a_cone_are_found() -> None:
    xyz, normals = _solids(8000)
    result = {
        (each.kind, abs(each.angle) > 0.1): each
        for each in detect_revolutions(xyz, normals, 10, 1.0)
    }
    tube, ball, hat = result[CONE, False], result[SPHERE, False], result[CONE, True]
    assert tube.radius == pytest.approx(150, abs=0.5)
    assert abs(tube.axis[2]) > 0.9999
    assert np.allclose(ball.origin, [600, 300, 300], atol=0.5)
    assert ball.radius == pytest.approx(120, abs=0.5)
    assert abs(hat.angle) == pytest.approx(np.arctan2(140, 400), abs=0.01)


def test_no_surfaces_of_revolution_are_detected_on_a_box() -> None:
    rng = np.random.default_rng(1)
    side = rng.integers(0, 6, 6000)
    xyz = rng.random((6000, 3)) * 1000
    xyz[np.arange(6000), side // 2] = side % 2 * 1000
    assert detect_revolutions(xyz, np.eye(3)[side // 2], 30.0, 3.0) == []


@cache
def _round_stream() -> bytes:
    cloud = prepare(
        _solids(4000)[0], PrimitiveSettings(min_leaf_size=32, column_size=16, lmbda=600)
    )
    coded = encode_surface(cloud, SurfaceMode(revolutions=revolution_candidates(cloud)))
    assert coded is not None
    return coded.stream


def test_streams_do_not_depend_on_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    xyz, _ = _solids(noise=1.0)
    streams = set()
    for threads in ("1", "2", "5"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        streams.add(encode(xyz, R3))
    assert len(streams) == 1


def test_round_solids_are_coded_as_surfaces_of_revolution() -> None:
    xyz, _ = _solids(noise=1.0)
    stream = encode(xyz, R3)
    header, _ = unpack(stream)
    assert isinstance(header, SurfaceHeader)
    assert len(header.revolutions) // REVOLUTION_BYTES >= 3
    mesh = decode_mesh(stream)
    assert mesh.labels is not None
    kinds = {primitive.kind for primitive in mesh.labels.primitives}
    assert {"cylinder", "sphere", "cone"} <= kinds
    ball = next(each for each in mesh.labels.primitives if each.kind == "sphere")
    assert ball.parameters["radius"] == pytest.approx(120, abs=3)
    decoded = decode_surface(stream)
    assert np.allclose(np.linalg.norm(decoded.normals, axis=1), 1)
    away = np.abs(np.linalg.norm(decoded.xyz - [600, 300, 300], axis=1) - 120)
    assert np.median(away[away < 10]) < 1


@settings(max_examples=60)
@given(data=st.data())
def test_damage_of_surfaces_of_revolution_ends_in_an_error_or_points(data: st.DataObject) -> None:
    header, bits = unpack(_round_stream())
    assert isinstance(header, SurfaceHeader)
    assert header.revolutions
    rounds, damaged = bytearray(header.revolutions), bytearray(bits)
    for part in (rounds, damaged):
        for _ in range(data.draw(st.integers(0, 3))):
            part[data.draw(st.integers(0, len(part) - 1))] = data.draw(st.integers(0, 255))
    changed = header._replace(revolutions=bytes(rounds))
    try:
        decoded = decode(pack_surface(changed, bytes(damaged)))
    except InputError:
        return
    assert np.isfinite(decoded).all()

"""Distances to primitives and their parameter_differences, in closed form."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from pointkit.geometry.mesh import Primitive, primitive_in_metres
from puckbench.metrics.primitive_differences import distances_to_primitive, parameter_differences
from virtual_lidar.scenes.surfaces import Shape, grid, primitive

UP = [0.0, 0.0, 1.0]
FLOOR = Primitive("plane", {"normal": UP, "offset": 1.0})
PIPE = Primitive("cylinder", {"point": [1.0, 0.0, 5.0], "axis": UP, "radius": 2.0})
BALL = Primitive("sphere", {"centre": [0.0, 0.0, 1.0], "radius": 0.5})
HAT = Primitive("cone", {"apex": [0.0, 0.0, 0.0], "axis": UP, "half_angle": np.pi / 4})
ORIGIN = np.zeros(3)


@pytest.mark.parametrize(
    ("surface", "point", "distance"),
    [
        (FLOOR, [7, 7, -2], 3),
        (PIPE, [1, 5, 100], 3),
        (PIPE, [1, 0, 0], 2),
        (BALL, [0, 3, 5], 4.5),
        (HAT, [3, 0, 3], 0),
        (HAT, [2, 0, 0], 2**0.5),
        (HAT, [0, 0, 2], 2**0.5),
        (HAT, [3, 0, -4], 5),  # beyond the apex
    ],
)
def test_distances_of_points(surface: Primitive, point: list[float], distance: float) -> None:
    assert distances_to_primitive(surface, np.array([point], float))[0] == pytest.approx(
        distance, abs=1e-12
    )


def test_distances_to_a_cone_are_those_to_the_nearest_of_its_points() -> None:
    """In the half plane of axis and point, the cone is a ray from the apex."""
    hat = Primitive("cone", {"apex": [0.0, 0.0, 0.0], "axis": UP, "half_angle": np.pi / 6})
    around = np.linspace(0, np.pi, 37)
    points = np.column_stack([np.sin(around), 0 * around, np.cos(around)])
    ray = np.linspace(0, 2, 20_001)[:, None] * [0.5, 0, np.cos(np.pi / 6)]
    nearest = cdist(points, ray).min(axis=1)
    np.testing.assert_allclose(distances_to_primitive(hat, points), nearest, atol=1e-4)


def test_planes_differ_where_they_are_and_whatever_their_sides() -> None:
    tilt = np.radians(3)
    tilted = Primitive("plane", {"normal": [0, -np.sin(tilt), -np.cos(tilt)], "offset": -1.25})
    differences = parameter_differences(FLOOR, tilted, np.array([5.0, 0, 1]))
    assert differences["angle_deg"] == pytest.approx(3)
    assert differences["position_m"] == pytest.approx(1.25 - np.cos(tilt))


def test_cylinders_differ_beside_their_points_and_not_along_their_axes() -> None:
    other = {"point": [1.3, 0.4, -20.0], "axis": [0.0, 0.0, -1.0], "radius": 2.1}
    differences = parameter_differences(PIPE, Primitive("cylinder", other), np.array([3.0, 0, 9]))
    assert differences == pytest.approx({"angle_deg": 0, "position_m": 0.5, "radius_m": 0.1})


def test_a_turned_cylinder_is_off_at_the_centre_of_the_points() -> None:
    axis = [np.sin(0.1), 0.0, np.cos(0.1)]
    turned = Primitive("cylinder", {"point": [1.0, 0.0, 0.0], "axis": axis, "radius": 2.0})
    differences = parameter_differences(PIPE, turned, np.array([3.0, 0, 9]))
    assert differences["angle_deg"] == pytest.approx(np.degrees(0.1))
    assert differences["position_m"] == pytest.approx(9 * np.sin(0.1))


def test_spheres_and_cones_differ_by_their_places_and_sizes() -> None:
    ball = Primitive("sphere", {"centre": [0.0, 0.3, 1.4], "radius": 0.4})
    assert parameter_differences(BALL, ball, ORIGIN) == pytest.approx(
        {"position_m": 0.5, "radius_m": 0.1}
    )
    cone = {"apex": [0.0, 0.0, 0.2], "axis": UP, "half_angle": np.pi / 4 - np.radians(2)}
    assert parameter_differences(HAT, Primitive("cone", cone), ORIGIN) == pytest.approx(
        {"angle_deg": 0, "position_m": 0.2, "half_angle_deg": 2}
    )


@pytest.mark.parametrize("surface", [FLOOR, PIPE, BALL, HAT], ids=lambda surface: surface.kind)
def test_distances_keep_when_points_and_primitive_are_brought_to_metres(surface: Primitive) -> None:
    scale, offset = 40.0, np.array([3.0, -2.0, 0.5])
    points = np.random.default_rng(1).normal(size=(20, 3)) * 4
    moved = primitive_in_metres(surface, scale, offset)
    there = distances_to_primitive(moved, points / scale + offset)
    np.testing.assert_allclose(there, distances_to_primitive(surface, points) / scale, atol=1e-12)


@pytest.mark.parametrize(
    "shape",
    [Shape("plane"), Shape("cylinder", (0.7,)), Shape("sphere", (0.7,)), Shape("cone", (), (0.6,))],
    ids=lambda shape: shape.kind,
)
def test_what_scenes_call_a_primitive_is_on_its_own_surface(shape: Shape) -> None:
    u, v = np.meshgrid(np.linspace(0, 6, 9), np.linspace(0.1, 1.5, 5), indexing="ij")
    on = {
        "plane": (u, v, 0 * u),
        "cylinder": (0.7 * np.cos(u), 0.7 * np.sin(u), v),
        "sphere": (0.7 * np.cos(u) * np.sin(v), 0.7 * np.sin(u) * np.sin(v), 0.7 * np.cos(v)),
        "cone": (v * np.tan(0.6) * np.cos(u), v * np.tan(0.6) * np.sin(u), v),
    }[shape.kind]
    surface = grid(np.stack(on, axis=-1), shape, np.eye(4)).at(1, 2, 3, turn=20, tilt=40, scale=1.5)
    placed = primitive(shape, surface.frames[0])
    np.testing.assert_allclose(distances_to_primitive(placed, surface.vertices), 0, atol=1e-12)

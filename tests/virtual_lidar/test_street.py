"""Generated streets: ground, free lane and visibility, by Open3D's ray casting."""

from __future__ import annotations

from functools import cache

import numpy as np
import open3d as o3d
import pytest
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Labels, Mesh, check_mesh
from pointkit.lidar.sensors import load_sensor
from tests.support.scenes_residuals import plane_alignment, worst_residual
from virtual_lidar import ScanJob, open_error_model, open_sweep, scan
from virtual_lidar.scenes.street import free_way, make_street, street_origin

LENGTH = 120.0
SEEDS = pytest.mark.parametrize("seed", [0, 5])
GROUND = {"road", "kerb", "pavement", "terrain"}


@cache
def street(seed: int = 0, length: float = LENGTH) -> Mesh:
    return make_street("street_1", seed, length)


@cache
def caster(seed: int = 0) -> o3d.t.geometry.RaycastingScene:
    mesh, scene = street(seed), o3d.t.geometry.RaycastingScene()
    vertices = o3d.core.Tensor(mesh.vertices.astype(np.float32))
    scene.add_triangles(vertices, o3d.core.Tensor(mesh.triangles.astype(np.uint32)))
    return scene


def cast(seed: int, starts: Floats, directions: Floats) -> tuple[Floats, NDArray[np.uint32]]:
    rays = np.hstack(np.broadcast_arrays(starts, directions)).astype(np.float32)
    hits = caster(seed).cast_rays(o3d.core.Tensor(rays))
    return hits["t_hit"].numpy(), hits["primitive_ids"].numpy()


def labels(seed: int = 0) -> Labels:
    result = street(seed).labels
    assert result is not None
    return result


def semantics(seed: int = 0) -> NDArray[np.str_]:
    """The semantic class of each triangle."""
    return np.array([item.semantic for item in labels(seed).objects])[labels(seed).object_id]


def boxes(kind: str, seed: int = 0) -> dict[str, Floats]:
    """Name and bounding box (2, 3) of each object of a kind."""
    mesh, result = street(seed), {}
    for number, item in enumerate(labels(seed).objects):
        if item.name.rpartition("_")[0] == kind:
            corners = mesh.corners()[labels(seed).object_id == number].reshape(-1, 3)
            result[item.name] = np.stack([corners.min(axis=0), corners.max(axis=0)])
    return result


def ground_height(xy: Floats, seed: int = 0) -> Floats:
    """Height of the ground at positions (n, 2), by rays from below."""
    starts = np.column_stack([xy, np.full(len(xy), -1.0)])
    return cast(seed, starts, np.array([[0.0, 0.0, 1.0]]))[0] - 1.0


@SEEDS
def test_labels_fit_the_triangles(seed: int) -> None:
    mesh = street(seed)
    check_mesh(mesh, "street")
    assert len(labels(seed).object_id) == len(labels(seed).primitive_id) == len(mesh.triangles)
    assert worst_residual(mesh) < 1e-8
    assert (plane_alignment(mesh) > 0.99).all()
    names = [item.name for item in labels(seed).objects]
    assert len(names) == len(set(names))


@SEEDS
def test_nothing_is_within_a_metre_of_the_free_way(seed: int) -> None:
    x, y, z = street_origin()
    first, last = free_way(LENGTH)
    assert last - first == LENGTH
    along = np.arange(x + first, x + last + 0.01, 0.25)
    places = np.column_stack([along, np.full(len(along), y), np.full(len(along), z)])
    near = caster(seed).compute_distance(o3d.core.Tensor(places.astype(np.float32))).numpy()
    assert near.min() >= 1.0
    around = np.radians(np.arange(0, 360, 5))
    rim = np.column_stack([np.full(len(around), first), y + np.cos(around), z + np.sin(around)])
    ahead, _ = cast(seed, rim, np.array([[1.0, 0.0, 0.0]]))
    assert ahead.min() > LENGTH


@SEEDS
def test_a_sensor_can_travel_the_whole_way(seed: int) -> None:
    first, last = free_way(LENGTH)
    rows = [[0.0, first, 0, 0, 0, 0, 0], [10.0, last, 0, 0, 0, 0, 0]]
    sweep = open_sweep({"preset": "spin", "trajectory": rows})
    model, sensor = open_error_model("none"), load_sensor("vlp16")
    ScanJob(street(seed), sensor, sweep, model, street_origin(), anywhere=False).check()


@SEEDS
def test_ground_has_no_gaps_and_no_overlaps(seed: int) -> None:
    low, high = street(seed).bounds()
    spots = np.random.default_rng(1).uniform(low[:2], high[:2], (20_000, 2))
    heights = ground_height(spots, seed)
    assert heights.min() > -1e-6
    assert heights.max() < 0.14
    flat = np.isin(semantics(seed), list(GROUND))
    down = street(seed).normals()[flat][:, 2]
    assert down.min() > -1e-9
    plan = np.sum(street(seed).areas()[flat] * down)
    assert plan == pytest.approx(np.prod(high[:2] - low[:2]), rel=1e-6)


def test_the_road_has_a_crown_and_kerbs_of_12_cm() -> None:
    x = np.linspace(-40.0, 40.0, 81)

    def height(y: float) -> Floats:
        return ground_height(np.column_stack([x, np.full(len(x), y)]))

    assert height(1e-3) == pytest.approx(0.135, abs=1e-3)
    for side in (-1.0, 1.0):
        assert height(side * 5.39) == pytest.approx(0.0, abs=1e-3)
        assert height(side * 5.41) == pytest.approx(0.12, abs=1e-6)
        assert height(side * 7.0) == pytest.approx(0.11, abs=1e-6)
        assert height(side * 2.7) == pytest.approx(0.135 / 2, abs=1e-3)


@SEEDS
def test_cars_stand_on_the_road_beside_the_lanes_and_apart(seed: int) -> None:
    cars = np.array(list(boxes("car", seed).values()))
    assert len(cars) > 8
    middle = np.abs(cars[:, :, 1].mean(axis=1))
    assert (np.abs(middle - 4.325) < 0.2).all()
    road = 0.135 * (1 - middle / 5.4)
    assert (np.abs(cars[:, 0, 2] - road) < 0.04).all()
    for side in (cars[:, 0, 1] > 0, cars[:, 0, 1] < 0):
        ordered = cars[side][np.argsort(cars[side][:, 0, 0])]
        assert (ordered[1:, 0, 0] > ordered[:-1, 1, 0]).all()


@SEEDS
def test_windows_are_behind_the_facade(seed: int) -> None:
    x, checked = np.arange(-50.0, 50.0, 0.05), 0
    numbers = {item.name: number for number, item in enumerate(labels(seed).objects)}
    for side in (-1.0, 1.0):
        starts = np.column_stack([x, np.zeros(len(x)), np.full(len(x), 4.6)])
        distance, triangle = cast(seed, starts, np.array([[0.0, side, 0.0]]))
        hit = np.isfinite(distance)
        owner, reach = labels(seed).object_id[triangle[hit]], distance[hit]
        for name in [item for item in numbers if item.startswith("house_")]:
            front = reach[owner == numbers[name]]
            panes = reach[owner == numbers[name.replace("house", "windows")]]
            if min(len(front), len(panes)) > 20:
                assert 0.1 < np.median(panes) - np.median(front) < 0.4
                checked += 1
    assert checked > 3


def test_crowns_are_partly_transparent() -> None:
    rng = np.random.default_rng(2)
    crowns = boxes("crown")
    assert len(crowns) > 10
    for name, (low, high) in crowns.items():
        middle, half = (low + high) / 2, (high - low) / 2
        targets = middle + half * rng.uniform(-0.6, 0.6, (400, 3))
        starts = targets - np.array([2 * half[0], 0.0, 0.0])
        distance, triangle = cast(0, starts, np.array([[1.0, 0.0, 0.0]]))
        met = np.isfinite(distance) & (distance < 4 * half[0])
        owner = np.array([item.name for item in labels().objects])[labels().object_id]
        share = np.mean(met & (owner[triangle % len(owner)] == name))
        assert 0.25 < share < 0.97
        assert np.std(distance[met]) > 0.3


@SEEDS
def test_a_sensor_sees_a_street(seed: int) -> None:
    sensor, sweep, mesh = load_sensor("vlp16"), open_sweep("spin"), street(seed, 200.0)
    rng = np.random.default_rng(0)
    table = scan(mesh, sensor, sweep, open_error_model("none"), street_origin(), rng).columns
    rays = sweep.steps(sensor) * sensor.lasers
    assert 0.6 < len(table["distance"]) / rays < 0.97
    assert table["distance"].min() > 1.5
    assert 7.0 < np.median(table["distance"]) < 20.0
    assert table["distance"].max() > 80.0
    assert mesh.labels is not None
    seen = {mesh.labels.objects[number].semantic for number in np.unique(table["object_id"])}
    assert seen >= GROUND | {"building", "window", "door", "car", "pole", "trunk", "vegetation"}
    normals = np.column_stack([table[f"n{axis}"] for axis in "xyz"])
    points = np.column_stack([table[axis] for axis in "xyz"]) - street_origin()
    assert np.mean(np.sum(normals * points, axis=1) > 0) < 1e-3


def test_seed_and_name_determine_the_street() -> None:
    first, again = street(3, 60.0), make_street("street_1", 3, 60.0)
    assert np.array_equal(first.vertices, again.vertices)
    assert np.array_equal(first.triangles, again.triangles)
    assert first.labels is not None
    assert again.labels is not None
    assert first.labels.primitives == again.labels.primitives
    assert first.labels.objects == again.labels.objects
    for other in (make_street("street_1", 4, 60.0), make_street("street_2", 3, 60.0)):
        shaped = other.vertices.shape == first.vertices.shape
        assert not shaped or (other.vertices != first.vertices).any()


@pytest.mark.parametrize("length", [40.0, 333.0])
def test_short_and_long_streets(length: float) -> None:
    mesh = make_street("street_2", 1, length)
    assert np.ptp(mesh.bounds()[:, 0]) == pytest.approx(length + 2 * (8.0 + 16.0))
    assert mesh.labels is not None
    kinds = {item.semantic for item in mesh.labels.objects}
    assert kinds >= GROUND | {"building", "car", "trunk", "pole", "shelter", "sign", "bench"}


def test_the_number_of_triangles_is_limited() -> None:
    assert 200_000 < len(street(0, 200.0).triangles) < 400_000

"""Mirrors against the law of reflection: what is seen in one lies at its mirror image."""

from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.mesh import Labels, Mesh, SceneObject
from pointkit.lidar.sensors import load_sensor
from tests.support.sensor_scenes import box, joined, quad
from virtual_lidar import COLUMNS, ScanTable, Sweep, open_error_model, scan

VLP16 = load_sensor("vlp16")
SWEEP = Sweep(duration_s=0.5, azimuth_step_deg=1.0, pitch_start_deg=-20, pitch_end_deg=20)


def labelled(*surfaces: tuple[Mesh, str]) -> Mesh:
    """Surfaces of two triangles each, every one an object of the class beside it."""
    ids = np.repeat(np.arange(len(surfaces), dtype=np.int32), 2)
    objects = tuple(SceneObject(f"{name}_{i}", name) for i, (_, name) in enumerate(surfaces))
    return joined([mesh for mesh, _ in surfaces], Labels(ids, ids, objects, ()))


def upright(y: float, half: float = 500.0) -> Mesh:
    return quad([-half, y, -half], [2 * half, 0, 0], [0, 0, 2 * half])


def scanned(mesh: Mesh, errors: str = "none", **options: Any) -> ScanTable:
    model = open_error_model(errors, {"receiver": {"mirrors": ["mirror"]}, **options})
    return scan(mesh, VLP16, SWEEP, model, [0.1, 0.3, 0.2], np.random.default_rng(1))


@pytest.mark.parametrize("errors", ["none", "beam_footprint", "vlp16_divergence"])
def test_a_wall_behind_the_sensor_is_seen_at_its_mirror_image(errors: str) -> None:
    """A mirror at y = 3 shows the wall at y = -4 at y = 10."""
    quiet = {} if errors == "none" else {"bias_sigma_m": 0, "ray_sigma_m": 0}
    table = scanned(labelled((upright(3), "mirror"), (upright(-4), "wall")), errors, **quiet)
    in_mirror = table.object_id == 0
    near = in_mirror & (table["distance_noisy"] < 20)
    assert near.sum() > 1000
    assert table["y_noisy"][near] == pytest.approx(10, abs=0.01 if errors != "none" else 1e-7)
    assert table["y"][in_mirror] == pytest.approx(3)
    assert table["y"][~in_mirror] == pytest.approx(-4)


def test_a_path_over_two_mirrors_is_twice_folded() -> None:
    """A corner of two mirrors sends a ray back in parallel: the wall at y = -4 at y = 6 + 4."""
    corner = labelled(
        (upright(3, half=40), "mirror"),
        (quad([3, -40, -40], [0, 80, 0], [0, 0, 80]), "mirror"),
        (quad([-40, -4, -40], [80, 0, 0], [0, 0, 80]), "wall"),
    )
    table = scanned(corner)
    yaw = np.degrees(table["yaw"])
    into = (table.object_id == 0) & (yaw > 300) & (yaw < 320) & (table["distance_noisy"] < 20)
    assert into.sum() > 50
    assert table["y_noisy"][into] == pytest.approx(10, abs=1e-7)


def test_a_path_is_followed_over_eight_mirrors() -> None:
    """Between mirrors at y = -1 and 1 what is seen in n of them lies 2 n - 1 to 2 n + 1 aside."""
    sides = [(upright(y), "mirror") for y in (-1, 1)]
    table = scanned(labelled(*sides, (quad([5, -1, -500], [0, 2, 0], [0, 0, 1000]), "wall")))
    assert 15 < np.abs(table["y_noisy"]).max() < 17


def test_the_path_counts_for_the_greatest_range() -> None:
    table = scanned(labelled((upright(3), "mirror"), (upright(-94.5), "wall")))
    assert not (table.object_id == 0).any()


def test_nothing_but_mirrors_returns_nothing() -> None:
    with pytest.raises(InputError, match="no ray returned"):
        scanned(labelled((upright(3), "mirror"), (upright(-3), "mirror")))


def test_without_a_mirror_in_the_scene_no_byte_changes() -> None:
    room = box([-3, -2, -1], [6, 5, 3])
    mirrored, plain = scanned(room, "vlp16"), scanned(room, "vlp16", receiver={})
    assert all(np.array_equal(mirrored[name], plain[name]) for name in COLUMNS)


def test_mirrors_need_labels() -> None:
    with pytest.raises(InputError, match="mirrors are given by object, but the mesh has no labels"):
        scanned(upright(3))

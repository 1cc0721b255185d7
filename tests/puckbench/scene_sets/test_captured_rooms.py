"""Captured rooms, on a look-alike: a box room with a table, turned in its world."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from puckbench.scene_sets.captured_rooms import CapturedRooms, read_capture

WIDTH, HEIGHT, DEPTH, TURN = 4.0, 2.5, 3.0, 25.0
TABLE = {"low": (-0.5, 0.0, -0.4), "high": (0.5, 0.75, 0.4)}
QUADS = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)


def box(low: Any, high: Any) -> tuple[Floats, Any]:
    """Corners (8, 3) and triangles (12, 3) of a box."""
    ends = np.stack([low, high])
    corners = np.array(
        [[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    )
    return corners, QUADS[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def refined(vertices: Floats, triangles: Any, times: int) -> tuple[Floats, Any]:
    """Cut every triangle into four, `times` times; the corners are not shared."""
    corners = vertices[triangles]
    for _ in range(times):
        a, b, c = corners.swapaxes(0, 1)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        corners = np.concatenate([np.stack(part, axis=1) for part in parts])
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def placed(rotation: Any, position: Any) -> dict[str, Any]:
    """An entity's place, all of it turned by TURN about the vertical axis."""
    from scipy.spatial.transform import Rotation

    world = Rotation.from_euler("y", TURN, degrees=True)
    quaternion = (world * rotation).as_quat()
    return {
        "orientation": dict(zip("xyzw", quaternion.tolist(), strict=True)),
        "position": dict(zip("xyz", world.apply(position).tolist(), strict=True)),
    }


def patch(label: str, normal: Any, centre: Any, width: float, height: float) -> dict[str, Any]:
    """A plane patch whose frame has its y axis along the normal."""
    from scipy.spatial.transform import Rotation

    side = np.cross(normal, [0, 0, 1]) if abs(normal[2]) < 0.5 else np.array([1.0, 0, 0])
    axes = np.stack([side, normal, np.cross(side, normal)], axis=1)
    extent = {"width": width, "height": height}
    offset = {"x": -width / 2, "y": -height / 2}
    place = placed(Rotation.from_matrix(axes), centre)
    bounds = {"offset": offset, "extent": extent}
    return {"semanticLabel_META": label, "locatable_META": place, "bounded2D_META": bounds}


def capture(mesh_label: str = "GLOBAL_MESH") -> dict[str, Any]:
    """The look-alike: floor, ceiling, two walls, a door, a table (as a box and as its top)."""
    from scipy.spatial.transform import Rotation

    shell = refined(*box((-WIDTH / 2, 0, -DEPTH / 2), (WIDTH / 2, HEIGHT, DEPTH / 2)), 4)
    table = refined(*box(TABLE["low"], TABLE["high"]), 2)
    vertices = np.concatenate([shell[0], table[0]])
    triangles = np.concatenate([shell[1], table[1] + len(shell[0])])
    turned = Rotation.from_euler("xyz", [40, 10, 70], degrees=True)
    local = turned.inv().apply(vertices - [0, 1.6, 0])
    mesh = {
        "vertices": base64.b64encode(local.astype("<f4").tobytes()).decode(),
        "indices": base64.b64encode(triangles.astype("<u4").tobytes()).decode(),
    }
    upright = Rotation.from_matrix(np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]))
    table_box = {
        "offset": {"x": -0.5, "y": -0.4, "z": -0.75},
        "extent": {"width": 1.0, "height": 0.8, "depth": 0.75},
    }
    entities = [
        patch("FLOOR", (0, 1, 0), (0, 0, 0), WIDTH, DEPTH),
        patch("CEILING", (0, -1, 0), (0, HEIGHT, 0), WIDTH, DEPTH),
        patch("WALL_FACE", (1, 0, 0), (-WIDTH / 2, HEIGHT / 2, 0), HEIGHT, DEPTH),
        patch("WALL_FACE", (-1, 0, 0), (WIDTH / 2, HEIGHT / 2, 0), HEIGHT, DEPTH),
        patch("DOOR_FRAME", (1, 0, 0), (-WIDTH / 2, 1.0, 0), 2.0, 1.0),
        patch("TABLE", (0, 1, 0), (0, 0.75, 0), 1.0, 0.8),
        {
            "semanticLabel_META": "TABLE",
            "locatable_META": placed(upright, (0, 0.75, 0)),
            "bounded3D_META": table_box,
        },
        {
            "semanticLabel_META": mesh_label,
            "locatable_META": placed(turned, (0, 1.6, 0)),
            "triangleMesh_META": mesh,
        },
    ]
    return {"type": "scene", "version": 1, "spatialEntities": entities}


@pytest.fixture
def rooms(tmp_path: Path) -> Path:
    (tmp_path / "office.json").write_text(json.dumps(capture()))
    (tmp_path / "office_large.json").write_text(json.dumps(capture("UNRECOGNIZED")))
    (tmp_path / "fetched.json").write_text('{"package": "no room"}')
    return tmp_path


def test_only_captures_are_scenes(rooms: Path) -> None:
    assert CapturedRooms(path=str(rooms)).names() == ["office", "office_large"]


@pytest.mark.parametrize("name", ["office", "office_large"])
def test_the_mesh_is_in_metres_with_z_up(rooms: Path, name: str) -> None:
    mesh = CapturedRooms(path=str(rooms)).load(name).mesh
    assert mesh is not None
    low, high = mesh.bounds()
    turn = np.radians(TURN)
    across = abs(WIDTH * np.cos(turn)) + abs(DEPTH * np.sin(turn))
    along = abs(WIDTH * np.sin(turn)) + abs(DEPTH * np.cos(turn))
    np.testing.assert_allclose(high - low, [across, along, HEIGHT], atol=1e-5)
    assert low[2] == pytest.approx(0, abs=1e-6)


def test_every_entity_labels_the_area_that_it_covers(rooms: Path) -> None:
    mesh = CapturedRooms(path=str(rooms)).load("office").mesh
    assert mesh is not None
    assert mesh.labels is not None
    areas = mesh.areas()
    covered = {item.semantic: 0.0 for item in mesh.labels.objects}
    for index, item in enumerate(mesh.labels.objects):
        covered[item.semantic] += areas[mesh.labels.object_id == index].sum()
    table_sides = 2 * (1.0 + 0.8) * 0.75
    # The table's foot lies in the floor; the two walls without an entity stay clutter.
    assert covered["ceiling"] == pytest.approx(WIDTH * DEPTH, rel=1e-5)
    assert covered["floor"] == pytest.approx(WIDTH * DEPTH + 1.0 * 0.8, rel=1e-5)
    assert covered["table"] == pytest.approx(1.0 * 0.8 + table_sides, rel=0.05)
    assert covered["door"] == pytest.approx(2.0 * 1.0, rel=0.15)
    assert covered["wall"] + covered["door"] == pytest.approx(2 * DEPTH * HEIGHT, rel=1e-5)
    assert covered["clutter"] == pytest.approx(2 * WIDTH * HEIGHT, rel=0.01)


def test_objects_have_names_of_their_own(rooms: Path) -> None:
    mesh = read_capture(rooms / "office.json").mesh
    assert mesh is not None
    assert mesh.labels is not None
    names = [item.name for item in mesh.labels.objects]
    assert len(set(names)) == len(names)
    assert {"wall_1", "wall_2", "door_1", "clutter_1"} <= set(names)


def damaged(entity: dict[str, Any], change: str) -> None:
    if change == "no place":
        del entity["locatable_META"]
    elif change == "no base64":
        entity["triangleMesh_META"]["vertices"] = "!?"
    elif change == "cut":
        entity["triangleMesh_META"]["vertices"] = entity["triangleMesh_META"]["vertices"][:-4]
    elif change == "beyond":
        entity["triangleMesh_META"]["vertices"] = entity["triangleMesh_META"]["vertices"][:160]
    elif change == "no mesh":
        del entity["triangleMesh_META"]


@pytest.mark.parametrize("change", ["no place", "no base64", "cut", "beyond", "no mesh"])
def test_a_damaged_capture_is_named(tmp_path: Path, change: str) -> None:
    content = capture()
    damaged(content["spatialEntities"][-1], change)
    path = tmp_path / "office.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError) as caught:
        read_capture(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ['{"spatialEntities": 3}', "[]", '{"spatialEntities": [', ""])
def test_json_that_is_no_capture_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "office.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"office\.json: "):
        read_capture(path)

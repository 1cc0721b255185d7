"""Rooms of 2D-3D-S on a small tree with its layout: frames, boxes, positions, labels, faults."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.mesh import Labels, Mesh
from puckbench.scene_sets.area_mesh import class_of, in_frame_of_s3dis, read_area_mesh, room_of
from puckbench.scene_sets.registry import open_scene_set
from puckbench.scene_sets.scene import Scene
from puckbench.scene_sets.stanford2d3d import Stanford2D3D
from tests.support import stanford_lookalike as lookalike
from tests.support.files import put


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return lookalike.make_tree(tmp_path)


def rooms(root: Path, **options: Any) -> Stanford2D3D:
    """The set in `root`, with listed positions unless `positions` is None."""
    values = {"positions": str(root / "positions"), **options}
    return Stanford2D3D(path=str(root / "2D-3D-S"), s3dis=str(root / "S3DIS"), **values)


def mesh_of(scene: Scene) -> tuple[Mesh, Labels]:
    assert scene.mesh is not None
    assert scene.mesh.labels is not None
    return scene.mesh, scene.mesh.labels


def test_a_room_of_both_halves_of_area_5_is_two_scenes(root: Path) -> None:
    names = ["area_1_hallway_1", "area_1_office_1", "area_5a_hallway_1", "area_5b_hallway_1"]
    assert rooms(root).names() == names
    assert rooms(root, areas=("area_5a",)).names() == ["area_5a_hallway_1"]


def test_names_need_no_mesh_and_no_cloud_to_be_readable(root: Path) -> None:
    put(root / "2D-3D-S/area_1/3d/semantic.obj", "v 1 2 bad")
    put(root / "S3DIS/Area_1/office_1/office_1.txt", "")
    assert len(rooms(root).names()) == 4


def test_files_are_the_mesh_the_rooms_cloud_and_the_positions(root: Path) -> None:
    names = [str(path.relative_to(root)) for path in rooms(root).files("area_5b_hallway_1")]
    assert names == [
        "2D-3D-S/area_5b/3d/semantic.obj",
        "S3DIS/Area_5/hallway_1/hallway_1.txt",
        "positions/locations_pruned5b.json",
    ]


def test_the_room_lies_in_its_box_z_up_with_the_scanner_in_it(root: Path) -> None:
    scene = rooms(root, margin_m=0.0).load("area_1_office_1")
    assert scene.group == "office"
    assert scene.origin == (3.0, 4.0, 1.4)
    assert scene.box is not None
    assert scene.box.tolist() == [list(corner) for corner in lookalike.OFFICE]
    assert scene.about["origin_in_box"]
    mesh, labels = mesh_of(scene)
    names = [labels.objects[index].name for index in labels.object_id]
    floor = mesh.corners()[[name == "floor_1_office_1_1" for name in names]]
    assert len(floor) == 2
    assert np.ptp(floor[..., 2]) == 0
    assert floor.reshape(-1, 3).min(axis=0).tolist() == [2, 3, 0]
    assert floor.reshape(-1, 3).max(axis=0).tolist() == [6, 7, 0]


def test_every_triangle_has_the_object_and_class_of_its_material(root: Path) -> None:
    mesh, labels = mesh_of(rooms(root).load("area_1_office_1"))
    assert {item.semantic for item in labels.objects} == {"floor", "ceiling", "wall", "unknown"}
    below = mesh.corners()[..., 2].max(axis=1) == 0
    classes = np.array([labels.objects[index].semantic for index in labels.object_id])
    assert set(classes[below]) == {"floor"}
    assert (classes == "floor").sum() == below.sum() == 4
    assert [item.kind for item in labels.primitives] == ["freeform"]


@pytest.mark.parametrize(
    ("margin", "triangles", "vertices"), [(0.0, 12, 8), (9.0, 12, 8), (11.0, 12 + 10, 16)]
)
def test_geometry_is_kept_up_to_the_margin_and_unused_vertices_go(
    root: Path, margin: float, triangles: int, vertices: int
) -> None:
    """A box 10 to 11 m beyond the room; its farthest side stays out of reach."""
    far = ("storage_1_5", ((16.0, 3.0, 0.0), (18.0, 4.0, 3.0)))
    lookalike.write_mesh(root, "5a", [("office_1_5", lookalike.OFFICE), far])
    lookalike.cloud(root, "Area_5/office_1/office_1.txt", lookalike.OFFICE)
    lookalike.positions(root, "5a", {"office_1_5": [3, 4, 1.4]})
    mesh, _ = mesh_of(rooms(root, areas=("area_5a",), margin_m=margin).load("area_5a_office_1"))
    assert len(mesh.triangles) == triangles
    assert len(np.unique(mesh.triangles)) == len(mesh.vertices) == vertices


def test_a_large_triangle_that_crosses_the_box_is_kept(root: Path) -> None:
    """The hallway's floor and ceiling pass a box in its middle without a vertex in it."""
    area = read_area_mesh(root / "2D-3D-S/area_1/3d/semantic.obj", "1")
    labels = area.near(np.array([[20, 3.5, -0.1], [21, 4.5, 3.1]]), 0.0).labels
    assert labels is not None
    assert {item.name for item in labels.objects} == {
        "floor_1_hallway_1_1",
        "ceiling_2_hallway_1_1",
    }


def test_triangles_without_area_are_left_out(root: Path) -> None:
    mesh, _ = mesh_of(rooms(root, margin_m=40.0).load("area_1_office_1"))
    assert (mesh.areas() > 0).all()
    assert len(mesh.triangles) == 2 * 12 + 1


def test_area_5b_is_moved_to_where_s3dis_has_it(root: Path) -> None:
    scene = rooms(root, margin_m=0.0).load("area_5b_hallway_1")
    mesh, _ = mesh_of(scene)
    np.testing.assert_allclose(mesh.bounds(), lookalike.WEST, atol=1e-5)
    np.testing.assert_allclose(np.array(scene.origin), (-3, 11, 1.4), atol=1e-9)
    assert scene.box is not None
    assert scene.box.tolist() == [list(corner) for corner in lookalike.LONG_HALLWAY]


def test_the_frame_of_5b_agrees_with_an_independent_calibration() -> None:
    """DeepViewAgg turns 5b's poses by this matrix and offset, found by hand, to fit S3DIS."""
    points = np.random.default_rng(1).uniform(-20, 20, (50, 3))
    expected = points @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]).T + (-4.10, 6.25, 0)
    moved = in_frame_of_s3dis(points, "5b")
    assert np.abs(moved - expected).max() < 0.03
    assert in_frame_of_s3dis(points, "5a") is points


def test_a_hallway_through_both_halves_runs_straight_after_the_move() -> None:
    """Tripods of 2D-3D-S's hallway_7 of area 5: x of those in 5a, and those in 5b moved."""
    in_5a = [-7.509789, -7.282448, -7.445973, -7.456826]
    in_5b = np.array([[-7.072574, -3.44351, 1.444], [2.512049, -3.400954, 1.450]])
    moved = in_frame_of_s3dis(in_5b, "5b")
    assert np.abs(moved[:, 0] - np.mean(in_5a)).max() < 0.2


@pytest.mark.parametrize(
    ("material", "semantic", "room"),
    [
        ("chair_12_office_3_1", "chair", "office_3"),
        ("wall_1_conferenceRoom_1_5a", "wall", "conferenceRoom_1"),
        ("table_2_WC_1_3.001", "table", "WC_1"),
        ("<UNK>_0_<UNK>_0_0", "unknown", None),
        ("None", "unknown", None),
    ],
)
def test_names_of_materials(material: str, semantic: str, room: str | None) -> None:
    assert class_of(material) == semantic
    assert room_of(material) == room


def test_without_a_list_the_camera_nearest_the_middle_of_the_box_is_taken(root: Path) -> None:
    near, far = {"camera_location": [3.9, 5.2, 1.4]}, {"camera_location": [2.2, 3.1, 1.4]}
    lookalike.pose(root, "0a1_office_1_frame_0", far)
    lookalike.pose(root, "0a1_office_1_frame_1", far)
    lookalike.pose(root, "0b2_office_1_frame_7", [near, far])
    lookalike.pose(root, "0c3_hallway_1_frame_0", {"camera_location": [20, 4, 1.4]})
    scenes = rooms(root, positions=None, areas=("area_1",))
    assert scenes.names() == ["area_1_hallway_1", "area_1_office_1"]
    poses = [path.name.split("_")[1] for path in scenes.files("area_1_office_1")[2:]]
    assert poses == ["0a1", "0b2"]
    assert scenes.load("area_1_office_1").origin == (3.9, 5.2, 1.4)


def test_poses_of_the_panoramas_will_do(root: Path) -> None:
    content = {"camera_location": [4, 5, 1.4]}
    lookalike.pose(root, "0a_office_1_frame_equirectangular", content, "pano/pose")
    scenes = rooms(root, positions=None, areas=("area_1",))
    assert scenes.load("area_1_office_1").origin == (4, 5, 1.4)


def test_one_area_is_read_once_for_all_its_rooms(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenes = rooms(root)
    scenes.load("area_1_office_1")
    monkeypatch.setattr("cloud_files.meshes.obj.read_bytes", lambda path: b"not read again")
    scenes.load("area_1_hallway_1")
    with pytest.raises(InputError, match="faces need materials"):
        scenes.load("area_5a_hallway_1")


MISSING = {
    "2D-3D-S": r"2D-3D-S: no such folder \(expected 2D-3D-S, .* form linked from the project",
    "2D-3D-S/area_1": r"area_1/3d/semantic.obj: no such file \(expected 2D-3D-S",
    "2D-3D-S/area_5b/3d/semantic.obj": r"area_5b/3d/semantic.obj: no such file",
    "S3DIS": r"S3DIS: no such folder \(expected S3DIS, version 1.2, not the aligned one",
    "S3DIS/Area_1/office_1": "S3DIS: 1 of 4 rooms are missing, such as Area_1_office_1",
    "positions": r"locations_pruned1.json: no such file \(expected the folder s3dis_locations of",
    "positions/locations_pruned5b.json": "locations_pruned5b.json: no such file",
}


@pytest.mark.parametrize("what", MISSING)
def test_what_is_missing_is_told_in_one_line(root: Path, what: str) -> None:
    (root / what).rename(root / "gone")
    with pytest.raises(InputError, match=MISSING[what]) as caught:
        rooms(root, areas=("area_1", "area_5a", "area_5b")).names()
    assert "\n" not in str(caught.value)


def test_without_poses_and_list_the_poses_are_missed(root: Path) -> None:
    with pytest.raises(InputError, match=r"area_1/data/pose: no camera_\*_pose.json, which give"):
        rooms(root, positions=None).names()


def test_no_area_at_all_and_an_unknown_one(root: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty: no areas"):
        Stanford2D3D(path=str(tmp_path / "empty"), s3dis=str(root / "S3DIS")).names()
    with pytest.raises(
        InputError, match=r"unknown name 'area_5' \(known: area_1, .*, area_5b, area_6"
    ):
        rooms(root, areas=("area_5",)).names()


def test_the_aligned_release_of_s3dis_is_noticed(root: Path) -> None:
    """The office turned by 90 degrees about z, as the aligned release has some rooms."""
    turned = ((-7.0, 2.0, 0.0), (-3.0, 6.0, 3.0))
    lookalike.cloud(root, "Area_1/office_1/office_1.txt", turned)
    with pytest.raises(InputError, match=r"0% of area_1_office_1 lies in its box .* aligned vers"):
        rooms(root).load("area_1_office_1")


def test_a_scanner_far_outside_the_room_is_an_error(root: Path) -> None:
    lookalike.positions(root, "1", {"office_1_1": [30.0, 4.0, 1.4]})
    with pytest.raises(InputError, match=r"pruned1.json: the scanner would stand 24.0 m outside"):
        rooms(root).load("area_1_office_1")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"office_1_1": [1.0, 2.0]}, r"office_1_1: \[1.0, 2.0\] is not a position"),
        ({"office_1_1": [[1.0, 2.0, 3.0]]}, "is not a position"),
        ({"office_1_1": [1.0, 2.0, None]}, "is not a position"),
        ({"office_1_1": [1.0, 2.0, float("nan")]}, "is not a position"),
        ({"office_1_6": [1.0, 2.0, 3.0]}, "'office_1_6' is not a room of area 1"),
        ({"office": [1.0, 2.0, 3.0]}, "'office' is not a room of area 1"),
        ({}, "not a list of positions"),
        ([[1.0, 2.0, 3.0]], "not a list of positions"),
    ],
)
def test_a_damaged_list_of_positions_is_an_error(root: Path, content: Any, message: str) -> None:
    lookalike.positions(root, "1", content)
    with pytest.raises(InputError, match=message):
        rooms(root).names()


@pytest.mark.parametrize("content", [{}, [], [1], {"camera_location": "there"}])
def test_a_damaged_pose_is_an_error(root: Path, content: Any) -> None:
    lookalike.pose(root, "0a_office_1_frame_0", content)
    with pytest.raises(InputError, match="camera_0a_office_1_frame_0_domain_pose"):
        rooms(root, positions=None, areas=("area_1",)).load("area_1_office_1")


def test_the_loader_is_registered_and_checks_its_options(root: Path) -> None:
    folders = {"path": str(root / "2D-3D-S"), "s3dis": str(root / "S3DIS")}
    options = {**folders, "positions": str(root / "positions"), "areas": ["area_5b"]}
    assert open_scene_set("stanford2d3d", options).names() == ["area_5b_hallway_1"]
    with pytest.raises(InputError, match="margin_m is -1, but must be greater than or equal to 0"):
        open_scene_set("stanford2d3d", {**folders, "margin_m": -1})

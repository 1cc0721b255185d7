"""Sets of rooms as meshes: ScanNet, Matterport3D and 3D-FRONT."""

import json
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.mesh import Mesh
from puckbench.scene_sets.front3d import Front3D
from puckbench.scene_sets.matterport3d import Matterport3D
from puckbench.scene_sets.scannet import ScanNet
from tests.support.files import put

PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
    "property uchar alpha\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0 1 1 1 255\n1 0 0 1 1 1 255\n0 0 2 1 1 1 255\n3 0 1 2\n"
)
QUARTER_TURN = "axisAlignment = 0 -1 0 5 1 0 0 6 0 0 1 7 0 0 0 1\nsceneType = Copy Room\n"


@pytest.fixture
def scans(tmp_path: Path) -> Path:
    """A scan with all of its files, one of the hidden test without a text, one without a mesh."""
    scan = tmp_path / "scans" / "scene0000_00"
    put(scan / "scene0000_00_vh_clean_2.ply", PLY)
    put(scan / "scene0000_00_vh_clean_2.labels.ply", PLY)
    put(scan / "scene0000_00.txt", QUARTER_TURN)
    put(tmp_path / "scans" / "scene0707_00" / "scene0707_00_vh_clean_2.ply", PLY)
    put(tmp_path / "scans" / "scene0001_00" / "scene0001_00.txt", "sceneType = Office\n")
    return tmp_path


def test_scannet_scans_have_the_type_of_their_room(scans: Path) -> None:
    rooms = ScanNet(path=str(scans))
    assert rooms.names() == ["scene0000_00", "scene0707_00"]
    assert rooms.names() == ScanNet(path=str(scans / "scans")).names()
    assert [rooms.load(name).group for name in rooms.names()] == ["copy_room", "unknown"]
    assert [path.name for path in rooms.files("scene0000_00")] == [
        "scene0000_00_vh_clean_2.ply",
        "scene0000_00.txt",
    ]


def test_a_scan_is_turned_along_the_axes_unless_that_is_not_wanted(scans: Path) -> None:
    turned = ScanNet(path=str(scans)).load("scene0000_00")
    as_captured = ScanNet(path=str(scans), aligned=False).load("scene0000_00")
    assert turned.mesh is not None
    assert as_captured.mesh is not None
    assert turned.mesh.vertices.tolist() == [[5, 6, 7], [5, 7, 7], [5, 6, 9]]
    assert as_captured.mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 0, 2]]
    assert (turned.about["aligned"], as_captured.about["aligned"]) == (True, False)


def test_a_damaged_alignment_is_named(scans: Path) -> None:
    put(scans / "scans" / "scene0000_00" / "scene0000_00.txt", "axisAlignment = 1 0 0\n")
    with pytest.raises(InputError, match=r"scene0000_00\.txt: axisAlignment"):
        ScanNet(path=str(scans)).load("scene0000_00")


def test_a_resolution_that_is_not_there_is_told(scans: Path) -> None:
    with pytest.raises(InputError, match=r"_vh_clean\.ply .*scan-net"):
        ScanNet(path=str(scans), full=True).names()


def test_matterport_regions_of_either_unpacking(tmp_path: Path) -> None:
    put(tmp_path / "17DRP5sb8fy" / "region_segmentations" / "region0.ply", PLY)
    put(tmp_path / "17DRP5sb8fy" / "region_segmentations" / "region0.vsegs.json", "{}")
    put(tmp_path / "1LXtFkjw3qL" / "1LXtFkjw3qL" / "region_segmentations" / "region10.ply", PLY)
    rooms = Matterport3D(path=str(tmp_path))
    assert rooms.names() == ["17DRP5sb8fy_region0", "1LXtFkjw3qL_region10"]
    scene = rooms.load("1LXtFkjw3qL_region10")
    assert scene.group == "1LXtFkjw3qL"
    assert scene.mesh is not None
    assert scene.mesh.bounds().tolist() == [[0, 0, 0], [1, 0, 2]]
    chosen = Matterport3D(path=str(tmp_path), buildings=("17DRP5sb8fy",))
    assert chosen.names() == ["17DRP5sb8fy_region0"]
    assert [(count.held, count.published) for count in chosen.counts()] == [(2, 90)]


# A chair of three vertices whose seat lies along x; turned by 90 degrees about y it lies along -z.
CHAIR = "v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n"
ABOUT_Y = [0, sqrt(0.5), 0, sqrt(0.5)]


def child(ref: str, pos: Any = (0, 0, 0), rot: Any = (0, 0, 0, 1), scale: Any = (1, 1, 1)) -> Any:
    return {"ref": ref, "pos": list(pos), "rot": list(rot), "scale": list(scale)}


def house() -> Any:
    """A room with floor, chair and furniture without a model; a room of only such; an empty one."""
    floor = {"uid": "m1", "type": "Floor", "xyz": [0, 0, 0, 4, 0, 0, 4, 0, 3], "faces": [0, 1, 2]}
    furniture = [
        {"uid": "f1", "jid": "chair-id", "category": "Dining Chair", "valid": True},
        {"uid": "f2", "jid": "lamp-id", "title": "lighting"},
        {"uid": "f3", "jid": "gone-id", "category": None, "title": "sofa", "valid": True},
    ]
    living = [
        child("m1"),
        child("f1", (1, 0.5, 2), ABOUT_Y, (2, 1, 1)),
        child("f1", (3, 0, 1)),
        child("f2"),
        child("f3"),
        child("nothing"),
    ]
    rooms = [
        {"type": "LivingRoom", "instanceid": "LivingRoom-12", "children": living},
        {"type": "Bedroom", "instanceid": "Bedroom-3", "children": [child("f3")]},
        {"type": "none", "instanceid": "none-4", "children": [child("f2")]},
        {"type": "Balcony", "instanceid": "Balcony-5", "children": []},
    ]
    return {"uid": "h", "furniture": furniture, "mesh": [floor], "scene": {"room": rooms}}


@pytest.fixture
def front(tmp_path: Path) -> Path:
    put(tmp_path / "3D-FRONT" / "abc.json", json.dumps(house()))
    put(tmp_path / "models" / "chair-id" / "raw_model.obj", CHAIR)
    return tmp_path


def open_front(root: Path, **options: Any) -> Front3D:
    return Front3D(path=str(root / "3D-FRONT"), models=str(root / "models"), **options)


def of(mesh: Mesh, index: int) -> Any:
    """Corners of the triangles of one object."""
    assert mesh.labels is not None
    return mesh.corners()[mesh.labels.object_id == index].reshape(-1, 3)


def test_rooms_with_nothing_to_show_are_no_scenes(front: Path) -> None:
    assert open_front(front).names() == ["abc_Bedroom-3", "abc_LivingRoom-12"]


def test_furniture_is_scaled_turned_moved_and_then_brought_to_z_up(front: Path) -> None:
    scene = open_front(front).load("abc_LivingRoom-12")
    assert scene.mesh is not None
    # y up: (1, 0, 0) is scaled to (2, 0, 0), turned to (0, 0, -2) and moved to (1, 0.5, 0).
    np.testing.assert_allclose(
        of(scene.mesh, 1), [[1, -2, 0.5], [1, 0, 0.5], [1, -2, 2.5]], atol=1e-12
    )
    np.testing.assert_allclose(of(scene.mesh, 2), [[3, -1, 0], [4, -1, 0], [3, -1, 2]])
    assert scene.box is not None
    assert scene.box.tolist() == [[0, -3, 0], [4, 0, 0]]
    assert scene.group == "livingroom"


def test_things_are_labelled_and_what_has_no_model_is_counted(front: Path) -> None:
    scene = open_front(front).load("abc_LivingRoom-12")
    assert scene.mesh is not None
    assert scene.mesh.labels is not None
    objects = [(item.name, item.semantic) for item in scene.mesh.labels.objects]
    assert objects == [
        ("Floor_1", "Floor"),
        ("Dining Chair_1", "Dining Chair"),
        ("Dining Chair_2", "Dining Chair"),
    ]
    assert scene.about["left_out"] == {
        "furniture_not_valid": 1,
        "model_missing": 1,
        "unknown_ref": 1,
    }


def test_the_files_are_the_house_and_each_model_once(front: Path) -> None:
    files = open_front(front).files("abc_LivingRoom-12")
    assert [path.name for path in files] == ["abc.json", "raw_model.obj"]


def test_a_room_whose_models_are_all_missing_is_named(front: Path) -> None:
    with pytest.raises(InputError, match=r"Bedroom-3: no item of the room has a surface"):
        open_front(front).load("abc_Bedroom-3")


def test_only_the_chosen_houses_are_read(front: Path) -> None:
    put(front / "3D-FRONT" / "abd.json", "{not JSON")
    assert open_front(front, houses=("abc",)).names() == open_front(front, houses=1).names()
    with pytest.raises(InputError, match=r"abd\.json: not valid JSON"):
        open_front(front).names()
    assert [(c.held, c.published) for c in open_front(front).counts()] == [(2, 6813)]


DAMAGE: dict[str, dict[str, Any]] = {
    "no scene": {"scene": None},
    "an index that is no number": {"mesh": [{"uid": "m1", "type": "Floor", "xyz": ["a"]}]},
    "no list of furniture": {"furniture": 3},
}


@pytest.mark.parametrize("what", DAMAGE)
def test_a_damaged_house_is_named(front: Path, what: str) -> None:
    put(front / "3D-FRONT" / "abc.json", json.dumps({**house(), **DAMAGE[what]}))
    with pytest.raises(InputError, match=r"abc\.json: not a readable house"):
        open_front(front).names()


@pytest.mark.parametrize("pose", [{"rot": [0, 0, 0, 0]}, {"pos": [1, 2]}, {"scale": ["a", 1, 1]}])
def test_a_damaged_pose_is_named(front: Path, pose: Any) -> None:
    content = house()
    content["scene"]["room"][0]["children"][1].update(pose)
    put(front / "3D-FRONT" / "abc.json", json.dumps(content))
    with pytest.raises(InputError, match=r"abc\.json: not a readable house"):
        open_front(front).names()


def test_missing_models_tell_where_to_ask(front: Path) -> None:
    rooms = Front3D(path=str(front / "3D-FRONT"), models=str(front / "nowhere"))
    with pytest.raises(InputError, match=r"nowhere: no such folder .*3D-FUTURE"):
        rooms.load("abc_LivingRoom-12")

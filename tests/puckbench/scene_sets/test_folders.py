"""Sets of mesh files: a folder of anything, and CAPOD."""

from pathlib import Path

import pytest

from pointkit.errors import InputError
from puckbench.scene_sets.capod import Capod
from puckbench.scene_sets.mesh_files import MeshFiles
from tests.support.files import put

TRIANGLE_OBJ = "v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n"
TRIANGLE_OFF = "OFF3 1 0\n0 0 0\n1 0 0\n0 2 0\n3 0 1 2\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Meshes in two groups and at the top, with files that are none."""
    files = {
        "top one.obj": TRIANGLE_OBJ,
        "top one.off": TRIANGLE_OFF,
        "chair/train/chair_0001.OFF": TRIANGLE_OFF,
        "table/t 1.obj": TRIANGLE_OBJ,
        "table/._t 1.obj": "resource fork",
        "table/t 1.mtl": "newmtl red",
        "readme.txt": "",
    }
    for name, text in files.items():
        put(tmp_path / "meshes" / name, text)
    return tmp_path / "meshes"


def test_a_folder_gives_safe_unique_names_and_groups(folder: Path) -> None:
    meshes = MeshFiles(path=str(folder))
    names = ["chair_0001", "t_1", "top_one_obj", "top_one_off"]
    assert meshes.names() == names
    assert [meshes.load(name).group for name in names] == ["train", "table", "meshes", "meshes"]
    assert meshes.files("t_1") == [folder / "table" / "t 1.obj"]
    assert MeshFiles(path=f"{folder}/*.obj").names() == ["top_one"]


def test_units_and_orientation_of_a_folder(folder: Path) -> None:
    scene = MeshFiles(path=str(folder), up="y", metres_per_unit=0.01).load("t_1")
    assert scene.mesh is not None
    assert scene.mesh.bounds().tolist() == [[0, 0, 0], [0.01, 0, 0.02]]


def test_an_unknown_scene_is_named(folder: Path) -> None:
    with pytest.raises(InputError, match="no scene 'sofa'"):
        MeshFiles(path=str(folder)).load("sofa")


def make_capod(root: Path) -> Path:
    """A CAPOD of two classes, with its numbering across classes."""
    put(root / "CAPOD.cla", "PSB 1\n2 3\n\nHuman 0 2\n1\n2\n\nDesktop_computer 0 1\n3\n\n")
    for index, number in ((1, 1), (1, 2), (2, 3)):
        put(root / f"class{index}" / f"m{number}.obj", TRIANGLE_OBJ + "l 1 2 3\n")
    return root


def test_capod_names_groups_and_counts(tmp_path: Path) -> None:
    capod = Capod(path=str(make_capod(tmp_path / "CAPOD")))
    assert capod.names() == ["m001", "m002", "m003"]
    assert [count.line() for count in capod.counts()] == [
        "2 of 15 published, which differs",
        "3 of 180 published, which differs",
    ]
    scene = capod.load("m003")
    assert scene.group == "Desktop_computer"
    assert scene.about["skipped"] == {"polylines": 1}
    assert "Papadakis" in scene.about["credit"]


def test_capod_by_class(tmp_path: Path) -> None:
    root = make_capod(tmp_path / "CAPOD")
    assert Capod(path=str(root), classes=("Human",)).names() == ["m001", "m002"]
    with pytest.raises(
        InputError, match=r"unknown name 'human' \(known: Human, Desktop_computer\)"
    ):
        Capod(path=str(root), classes=("human",)).names()


def test_capod_tells_what_is_missing(tmp_path: Path) -> None:
    root = make_capod(tmp_path / "CAPOD")
    (root / "class1" / "m2.obj").unlink()
    with pytest.raises(InputError, match=r"1 of 3 objects are missing, such as class1/m2\.obj"):
        Capod(path=str(root)).names()


@pytest.mark.parametrize(
    "text", ["", "PSB 1\n", "PSB 1\n1 2\nHuman 0 2\n1\n", "PSB 1\n1 2\nHuman 0 1\n1\n", "OFF 1 1 1"]
)
def test_a_damaged_classification_is_named(tmp_path: Path, text: str) -> None:
    root = make_capod(tmp_path / "CAPOD")
    (root / "CAPOD.cla").write_text(text)
    with pytest.raises(InputError, match=r"CAPOD\.cla: "):
        Capod(path=str(root)).names()

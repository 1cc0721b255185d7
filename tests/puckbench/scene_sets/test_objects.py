"""Object sets in the layouts of ModelNet40, ShapeNetCore and the Stanford scans."""

from pathlib import Path
from typing import Any

import pytest

from pointkit.errors import InputError
from puckbench.scene_sets.modelnet40 import ModelNet40
from puckbench.scene_sets.registry import open_scene_set
from puckbench.scene_sets.shapenetcore import ShapeNetCore
from puckbench.scene_sets.stanford_scans import StanfordScans
from tests.support.files import put

TRIANGLE_OBJ = "v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1/1 2/2 3/3\n"
CORNERS = "0 0 0\n1 0 0\n0 2 0\n"
PLY = (
    "ply\nformat ascii 1.0\ncomment zipper output\nelement vertex 3\nproperty float x\n"
    "property float y\nproperty float z\nproperty float confidence\nproperty float intensity\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0 1 0.5\n100 0 0 1 0.5\n0 200 0 1 0.5\n3 0 1 2\n"
)


@pytest.fixture
def modelnet(tmp_path: Path) -> Path:
    """Two classes, one of two words; the second model has its header glued to the counts."""
    root = tmp_path / "ModelNet40"
    put(root / "chair" / "train" / "chair_0001.off", f"OFF\n3 1 0\n{CORNERS}3 0 1 2\n")
    put(root / "chair" / "test" / "chair_0890.off", f"OFF3 1 0\n{CORNERS}3 0 1 2\n")
    put(root / "night_stand" / "train" / "night_stand_0001.off", f"OFF\n3 1 0\n{CORNERS}3 0 1 2\n")
    put(root / "chair" / "train" / "._chair_0001.off", "resource fork")
    put(root / "README.txt", "")
    return root


def test_modelnet_has_classes_and_splits(modelnet: Path) -> None:
    assert ModelNet40(path=str(modelnet)).names() == [
        "chair_0001",
        "chair_0890",
        "night_stand_0001",
    ]
    assert ModelNet40(path=str(modelnet), split="test").names() == ["chair_0890"]
    assert ModelNet40(path=str(modelnet), classes=("night_stand",)).names() == ["night_stand_0001"]
    assert ModelNet40(path=str(modelnet)).load("night_stand_0001").group == "night_stand"


def test_a_header_glued_to_the_counts_is_read(modelnet: Path) -> None:
    models = ModelNet40(path=str(modelnet))
    plain, glued = models.load("chair_0001"), models.load("chair_0890")
    assert plain.mesh is not None
    assert glued.mesh is not None
    assert glued.mesh.vertices.tolist() == plain.mesh.vertices.tolist()


def test_modelnets_counts_are_those_of_all_classes(modelnet: Path) -> None:
    counts = ModelNet40(path=str(modelnet), classes=("chair",), split="test").counts()
    held = {count.what: (count.held, count.published) for count in counts}
    assert held == {"classes": (2, 40), "train": (2, 9843), "test": (1, 2468)}
    assert sum(count.published for count in counts[1:]) == 12_311


@pytest.mark.parametrize(
    ("options", "message"),
    [({"split": "val"}, "split is 'val'"), ({"classes": ["sofa"]}, "unknown name 'sofa'")],
)
def test_a_wrong_choice_of_modelnet_is_named(
    modelnet: Path, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        open_scene_set("modelnet40", {"path": str(modelnet), **options}).names()


def test_a_class_without_models_of_the_split_is_told(modelnet: Path) -> None:
    with pytest.raises(InputError, match="no models"):
        ModelNet40(path=str(modelnet), classes=("night_stand",), split="test").names()


@pytest.fixture
def shapenet(tmp_path: Path) -> Path:
    """Models of both versions, one folder without its model, one known to have no vertices."""
    root = tmp_path / "ShapeNetCore"
    put(root / "03001627" / "1a6f" / "model.obj", TRIANGLE_OBJ)
    put(root / "03001627" / "2b7e" / "models" / "model_normalized.obj", TRIANGLE_OBJ)
    put(root / "02958343" / "d92a" / "images" / "texture0.jpg", "")
    put(root / "02958343" / "e03b" / "models" / "model_normalized.obj", TRIANGLE_OBJ)
    put(root / "04090263" / "4a32519f44dc84aabafe26e2eb69ebf4" / "model.obj", "vt 0 0\n")
    put(root / "99999999" / "c" / "model.obj", TRIANGLE_OBJ)
    put(root / "taxonomy.json", "[]")
    return root


def test_both_versions_of_shapenet_are_read_and_missing_models_left_out(shapenet: Path) -> None:
    models = ShapeNetCore(path=str(shapenet))
    assert models.names() == ["99999999_c", "car_e03b", "chair_1a6f", "chair_2b7e"]
    sources = [models.load(name).about["source"] for name in models.names()[2:]]
    assert sources == [
        "ShapeNetCore.v1 03001627/1a6f/model.obj",
        "ShapeNetCore.v2 03001627/2b7e/models/model_normalized.obj",
    ]


def test_shapenet_is_turned_from_y_up_to_z_up(shapenet: Path) -> None:
    scene = ShapeNetCore(path=str(shapenet), classes=("chair",)).load("chair_1a6f")
    assert scene.mesh is not None
    assert scene.mesh.bounds().tolist() == [[0, 0, 0], [1, 0, 2]]
    assert scene.group == "chair"


def test_shapenets_classes_are_counted(shapenet: Path) -> None:
    (count,) = ShapeNetCore(path=str(shapenet), classes=("chair",)).counts()
    assert (count.held, count.published) == (3, 55)


def test_stanford_models_are_found_by_their_files_and_have_their_units(tmp_path: Path) -> None:
    put(tmp_path / "bunny" / "reconstruction" / "bun_zipper.ply", PLY)
    put(tmp_path / "bunny" / "reconstruction" / "bun_zipper_res2.ply", PLY)
    put(tmp_path / "bunny" / "data" / "bun000.ply", PLY)
    put(tmp_path / "lucy.ply", PLY)
    models = StanfordScans(path=str(tmp_path))
    assert models.names() == ["bunny", "lucy"]
    bunny, lucy = models.load("bunny"), models.load("lucy")
    assert bunny.mesh is not None
    assert lucy.mesh is not None
    assert bunny.mesh.bounds()[1].tolist() == [100, 0, 200]  # metres, y up
    assert lucy.mesh.bounds()[1].tolist() == [0.1, 0.2, 0]  # millimetres, z up
    assert (bunny.about["triangles"], bunny.about["faces_expected"]) == (1, 69_451)


def test_a_stanford_model_that_is_not_there_is_named(tmp_path: Path) -> None:
    put(tmp_path / "bun_zipper.ply", PLY)
    with pytest.raises(InputError, match=r"unknown name 'dragon' \(known: bunny\)"):
        StanfordScans(path=str(tmp_path), models=("dragon",)).names()

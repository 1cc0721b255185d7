"""Names of scenes, and opening scene sets by name."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.registry import Registry, trust
from puckbench.scene_sets.registry import LOADERS, open_scene_set
from puckbench.scene_sets.scene import Scene, safe_name, unique_names


def test_names_are_file_name_safe() -> None:
    assert safe_name("copy room/1 (ä).txt") == "copy_room_1_a_.txt"
    assert unique_names(["Höhen Straße 1", "Hühe", "H he"]) == ["Hohen_Strasse_1", "Huhe", "H_he"]
    assert safe_name("../..") == "unnamed"


def test_names_are_short_and_end_without_many_repetitions() -> None:
    """Snakemake refuses wildcards whose end repeats 20 times; a file's name has 255 bytes."""
    assert safe_name("ab1c" * 60 + "d") == "ab1c"
    assert safe_name("scan_" + "0" * 19) == "scan_" + "0" * 19
    assert safe_name("scan_" + "0" * 20) == "scan_0"
    numbers = "".join(map(str, range(999)))
    assert safe_name(numbers) == numbers[:128]
    assert unique_names([numbers, f"{numbers}2"]) == [numbers[:128], f"{numbers[:128]}_2"]


def test_names_are_unique_even_where_case_does_not_count() -> None:
    assert unique_names(["a b", "a_b", "A_B", "a_b_2"]) == ["a_b", "a_b_2", "A_B_3", "a_b_2_2"]


def test_a_scene_has_a_mesh_or_a_cloud() -> None:
    with pytest.raises(ValueError, match="needs one of a mesh, a cloud and returns"):
        Scene("a", "b")
    assert Scene("a", "b", cloud=PointCloud(np.zeros((1, 3)))).mesh is None


@pytest.mark.parametrize("loader", LOADERS.names())
def test_every_loader_can_be_loaded_and_is_a_scene_set(loader: str) -> None:
    result = LOADERS.get(loader)
    assert all(callable(getattr(result, member)) for member in ("names", "files", "load"))


@pytest.mark.parametrize("loader", LOADERS.names())
def test_every_option_is_described(loader: str) -> None:
    assert all(option.description for option in LOADERS.get(loader).model_fields.values())


WRONG: list[tuple[str, Mapping[str, Any], str]] = [
    ("capot", {}, "unknown loader 'capot'.*did you mean 'capod'"),
    (
        "capod",
        {"path": "x", "clases": ["Car"]},
        "unknown option 'clases' .known: path, classes.; did you mean 'classes'",
    ),
    ("capod", {}, "the option 'path' is missing"),
    ("capod", {"path": 3}, "path is 3, but must be a valid string"),
    ("capod", {"path": "x", "classes": "Car"}, "classes is 'Car', but must be a list"),
    ("kitti", {"path": "x", "returns": 1}, "returns is 1, but must be a valid boolean"),
    (
        "mesh_files",
        {"path": "x", "metres_per_unit": True},
        "metres_per_unit is True, but must be a valid number",
    ),
    (
        "mesh_files",
        {"path": "x", "metres_per_unit": 0},
        "metres_per_unit is 0, but must be greater than 0",
    ),
    ("mesh_files", {"path": "x", "up": "x"}, "up is 'x', but must be 'y' or 'z'"),
]


@pytest.mark.parametrize(("loader", "options", "message"), WRONG)
def test_a_wrong_option_is_named(loader: str, options: Mapping[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        open_scene_set(loader, options)


SETS_ON_DISK = [
    "capod",
    "captured_rooms",
    "inter_lpcm",
    "kitti",
    "matterport3d",
    "mesh_files",
    "modelnet40",
    "s3dis",
    "scannet",
    "sfnd_lidar",
    "shapenetcore",
    "stanford_scans",
    "sweethome3d",
    "voxelised8i",
]


@pytest.mark.parametrize("loader", SETS_ON_DISK)
@pytest.mark.parametrize("exists", [True, False])
def test_a_missing_or_empty_folder_is_named(tmp_path: Path, loader: str, exists: bool) -> None:
    folder = tmp_path / "data"
    if exists:
        folder.mkdir()
    with pytest.raises(InputError) as caught:
        open_scene_set(loader, {"path": str(folder)}).names()
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)


ASKED_FOR = ["kitti", "matterport3d", "modelnet40", "scannet", "shapenetcore", "voxelised8i"]


@pytest.mark.parametrize("loader", ASKED_FOR)
@pytest.mark.parametrize("exists", [True, False])
def test_a_set_that_is_not_there_tells_what_to_put_there(
    tmp_path: Path, loader: str, exists: bool
) -> None:
    folder = tmp_path if exists else tmp_path / "data"
    with pytest.raises(InputError, match=r"expected .*, with"):
        open_scene_set(loader, {"path": str(folder)}).names()


SPHERES = """
from puckbench.scene_sets.base import SceneSet
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene
from pointkit.geometry.mesh import Mesh

@LOADERS.register("spheres")
class Spheres(SceneSet):
    seed: int = 0
    radii: tuple[float, ...] = (1.0,)

    def names(self):
        return [f"s{number}" for number in range(len(self.radii))]

    def files(self, name):
        return []

    def load(self, name):
        import trimesh

        sphere = trimesh.creation.icosphere(1, self.radii[int(name[1:])])
        return Scene(name, "sphere", mesh=Mesh(sphere.vertices, sphere.faces))
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package with a data set is installed, as pip leaves it: a module and its metadata."""
    metadata = tmp_path / "spheres-1.dist-info"
    metadata.mkdir()
    (tmp_path / "spheres_of_a_package.py").write_text(SPHERES)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: spheres\nVersion: 1\n")
    (metadata / "entry_points.txt").write_text(
        "[puckbench.loaders]\nspheres = spheres_of_a_package:Spheres\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("puckbench.scene_sets.registry.LOADERS", Registry("loader", "scene_sets"))


def test_a_package_brings_a_data_set(installed: None) -> None:
    spheres = open_scene_set("spheres", {"radii": [1, 2]}, seed=3)
    assert spheres.names() == ["s0", "s1"]
    assert spheres.files("s1") == []
    mesh = spheres.load("s1").mesh
    assert mesh is not None
    assert np.ptp(mesh.bounds(), axis=0) == pytest.approx(4, rel=0.1)
    with pytest.raises(InputError, match="loader spheres: unknown option 'radius'"):
        open_scene_set("spheres", {"radius": 1})
    with pytest.raises(InputError, match=r"unknown loader 'sphere'.*did you mean 'spheres'"):
        open_scene_set("sphere", {})


def test_a_file_outside_the_tree_brings_a_data_set(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(SPHERES.replace('@LOADERS.register("spheres")\n', ""))
    trust([f"{path}:Spheres"])
    spheres: Any = open_scene_set(f"{path}:Spheres", {"radii": [1, 2]}, seed=3)
    assert (spheres.seed, spheres.radii, spheres.names()) == (3, (1.0, 2.0), ["s0", "s1"])
    with pytest.raises(InputError, match=r"radii.1 is 'two', but must be a valid number"):
        open_scene_set(f"{path}:Spheres", {"radii": [1, "two"]})


def test_a_class_that_is_no_data_set_is_named(tmp_path: Path) -> None:
    (path := tmp_path / "mine.py").write_text("class Mine:\n    pass\n")
    trust([f"{path}:Mine"])
    with pytest.raises(InputError, match=r"Mine: not a class derived from .*base\.SceneSet"):
        open_scene_set(f"{path}:Mine", {})
    base = "from puckbench.scene_sets.base import SceneSet\n\n\nclass Half(SceneSet):\n"
    (path := tmp_path / "half.py").write_text(f"{base}    def names(self): return []\n")
    trust([f"{path}:Half"])
    with pytest.raises(InputError, match=r"half.py:Half: Half lacks files, load"):
        open_scene_set(f"{path}:Half", {})


def test_the_options_seed_wins(installed: None) -> None:
    spheres: Any = open_scene_set("spheres", {"seed": 1}, seed=5)
    assert spheres.seed == 1

"""Names of scenes, and opening scene sets by name."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from puckbench.core.errors import InputError
from puckbench.datasets.registry import REGISTRY, open_scene_set
from puckbench.datasets.scene import Scene, safe_name, unique_names
from puckbench.geometry.cloud import PointCloud


def test_names_are_file_name_safe() -> None:
    assert safe_name("copy room/1 (ä).txt") == "copy_room_1_.txt"
    assert safe_name("../..") == "unnamed"


def test_names_are_unique_even_where_case_does_not_count() -> None:
    assert unique_names(["a b", "a_b", "A_B", "a_b_2"]) == ["a_b", "a_b_2", "A_B_3", "a_b_2_2"]


def test_a_scene_has_a_mesh_or_a_cloud() -> None:
    with pytest.raises(ValueError, match="needs a mesh or a cloud"):
        Scene("a", "b")
    assert Scene("a", "b", cloud=PointCloud(np.zeros((1, 3)))).mesh is None


@pytest.mark.parametrize("loader", REGISTRY)
def test_every_loader_can_be_loaded_and_is_a_scene_set(loader: str) -> None:
    from puckbench.core.plugins import load_class

    found = load_class(REGISTRY[loader], loader)
    assert all(callable(getattr(found, member)) for member in ("names", "files", "load"))


WRONG: list[tuple[str, Mapping[str, Any], str]] = [
    ("capot", {}, "unknown loader 'capot'.*capod"),
    ("capod", {"path": "x", "clases": ["Car"]}, "unknown option 'clases'.*classes"),
    ("capod", {}, "the option 'path' is missing"),
    ("capod", {"path": 3}, "option 'path' is 3, which is not str"),
    ("capod", {"path": "x", "classes": "Car"}, "'Car', which is not a list of names or None"),
    ("mesh_folder", {"path": "x", "recursive": 1}, "option 'recursive' is 1, which is not bool"),
    ("mesh_folder", {"path": "x", "metres_per_unit": True}, "which is not float"),
    ("mesh_folder", {"path": "x", "metres_per_unit": 0}, "metres_per_unit: 0 is not above 0"),
    ("mesh_folder", {"path": "x", "up": "x"}, "up: 'x' is not allowed"),
]


@pytest.mark.parametrize(("loader", "options", "message"), WRONG)
def test_a_wrong_option_is_named(loader: str, options: Mapping[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        open_scene_set(loader, options)


SETS_ON_DISK = [
    "capod",
    "captured_rooms",
    "kitti",
    "matterport3d",
    "mesh_folder",
    "modelnet40",
    "s3dis",
    "scannet",
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
    with pytest.raises(InputError, match=r"should lie there, .* in it"):
        open_scene_set(loader, {"path": str(folder)}).names()


def test_a_loader_of_ones_own(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        "from dataclasses import dataclass\n\n"
        "@dataclass(frozen=True)\nclass Mine:\n    seed: int = 0\n    size: float = 1.0\n"
    )
    mine: Any = open_scene_set(f"{path}:Mine", {"size": 2}, seed=5)
    assert (mine.seed, mine.size) == (5, 2)


def test_the_options_seed_wins(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        "from dataclasses import dataclass\n\n@dataclass(frozen=True)\nclass Mine:\n    seed: int\n"
    )
    mine: Any = open_scene_set(f"{path}:Mine", {"seed": 1}, seed=5)
    assert mine.seed == 1

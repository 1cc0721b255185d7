"""Scene sets that were written when members had other names still run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pointkit.errors import InputError
from pointkit.registry import trust
from puckbench.scene_sets.registry import open_scene_set
from tests.puckbench.scene_sets.test_folders import TRIANGLE_OBJ
from tests.support.files import put

OLD = """
from puckbench.scene_sets.base import MeshFolderSet


class Old(MeshFolderSet):
    licence, credit, expected = "CC0", "nobody", "expected triangles"

    def _listed(self, folder):
        table = {path.stem: path for path in folder.glob("*.obj")}
        if not table:
            raise self._missing("triangles")
        return table

    def _group(self, path):
        return "old"

    def _read(self, path):
        mesh, report = super()._read(path)
        return mesh, {**report, "file": self._file(path.stem).name}


class Older(Old):
    def _source(self, path):
        return self._about("older")["source"]
"""


@pytest.fixture
def place(tmp_path: Path) -> str:
    put(tmp_path / "old.py", OLD)
    place = f"{tmp_path / 'old.py'}:Older"
    trust([place])
    return place


def test_old_members_are_called_and_told(
    tmp_path: Path, place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    put(tmp_path / "data" / "a.obj", TRIANGLE_OBJ)
    scenes: Any = open_scene_set(place, {"path": str(tmp_path / "data")})
    renamed = "_listed is now listed, _group is now group_of, _read is now read_mesh"
    assert capsys.readouterr().err.splitlines() == [
        f"puckbench: scene set Old has old names: {renamed}",
        "puckbench: scene set Older has old names: _source is now source_of",
    ]
    assert scenes.names() == ["a"]
    scene = scenes.load("a")
    assert (scene.group, scene.about["source"], scene.about["file"]) == ("old", "older", "a.obj")


def test_errors_come_as_before(tmp_path: Path, place: str) -> None:
    (tmp_path / "data").mkdir()
    with pytest.raises(InputError, match=r"data: no triangles \(expected triangles\)"):
        open_scene_set(place, {"path": str(tmp_path / "data")}).names()

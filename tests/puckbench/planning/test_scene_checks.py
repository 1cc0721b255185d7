"""Meshes that a data set cannot use are found before a run, left out and named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from pointkit.errors import InputError
from puckbench.planning.config import checked
from puckbench.planning.plan import Plan
from puckbench.planning.running import left_out_lines


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    """A room, a block with no room inside, and a file that ends too early."""
    folder = tmp_path / "meshes"
    folder.mkdir()
    room = trimesh.creation.box((5, 4, 3))
    room.invert()
    room.export(folder / "room.off")
    trimesh.creation.box((0.5, 0.5, 0.5)).export(folder / "solid.off")
    (folder / "torn.off").write_text("OFF\n8 12 0\n0 0\n")
    return folder


def plan(meshes: Path, data: dict[str, Any] | None = None, **top: Any) -> Plan:
    scanned = {"scene_set": "mine", "make": "scan", **(data or {})}
    scenes = {"mine": {"loader": "mesh_files", "options": {"path": str(meshes)}}}
    results = str(meshes.parent / "results")
    config = {"results": results, "scene_sets": scenes, "datasets": {"scanned": scanned}, **top}
    planned = Plan(checked(config), check_scenes=True)
    planned.memory.save()
    return planned


def test_scenes_that_cannot_be_scanned_are_left_out_and_named(meshes: Path) -> None:
    planned = plan(meshes)
    assert planned.clouds == (("scanned", "room"),)
    solid, torn = left_out_lines(planned.left_out_rows())
    assert solid.startswith(f"left out: {meshes}/solid.off: the scene has no free position 1.3 m")
    assert "torn.off: truncated" in torn


def test_a_block_can_be_sampled(meshes: Path) -> None:
    planned = plan(meshes, {"make": "sample", "points": 10})
    assert [cloud for _, cloud in planned.clouds] == ["room", "solid"]


def test_a_strict_run_stops_at_the_first_of_them(meshes: Path) -> None:
    with pytest.raises(InputError, match=r"^datasets.scanned: scene solid: .* no free position"):
        plan(meshes, strict=True)


def test_a_data_set_without_a_usable_scene_is_an_error(meshes: Path) -> None:
    (meshes / "room.off").unlink()
    with pytest.raises(InputError, match=r"^datasets.scanned: scene solid"):
        plan(meshes)


def test_a_configured_place_is_used_and_checked(meshes: Path) -> None:
    where = {"room": [1.0, 1.0, 0.0], "solid": [0.0, 0.0, 0.0]}
    planned = plan(meshes, {"origin": where})
    assert planned.clouds == (("scanned", "room"),)
    assert "is enclosed" in planned.left_out["scanned"]["solid"]
    with pytest.raises(InputError, match=r"room: the sensor at .* is outside the scene"):
        plan(meshes, {"origin": [9.0, 0.0, 0.0]})


def test_points_are_not_taken_for_a_mesh(meshes: Path) -> None:
    (meshes / "points.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n0 0 0\n"
    )
    assert plan(meshes).clouds == (("scanned", "room"),)


def test_a_mesh_is_looked_at_again_only_when_it_changed(
    meshes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan(meshes)
    looked: list[str] = []
    from puckbench.scene_sets.mesh_files import MeshFiles

    load = MeshFiles.load
    monkeypatch.setattr(
        MeshFiles, "load", lambda self, name: looked.append(name) or load(self, name)
    )
    plan(meshes)
    assert looked == []
    (meshes / "torn.off").write_text((meshes / "room.off").read_text())
    assert len(plan(meshes).clouds) == 2
    assert looked == ["torn"]


def test_a_scanned_mesh_in_millimetres_is_remarked_upon_and_a_sampled_one_is_not(
    meshes: Path, caplog: pytest.LogCaptureFixture
) -> None:
    trimesh.creation.box((5000, 4000, 3000)).export(meshes / "big.off")
    plan(meshes, {"make": "sample", "points": 10})
    assert not caplog.records
    plan(meshes, {"anywhere": True})
    (line,) = [record.getMessage() for record in caplog.records]
    assert line.startswith(f"{meshes / 'big.off'}: spans 5000 m: ")


def test_a_metric_cloud_in_millimetres_is_remarked_upon_and_a_scaled_one_is_not(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "room.xyz").write_text("0 0 0\n4000 0 0\n0 4000 0\n")
    scenes = {"mine": {"loader": "point_clouds", "options": {"path": str(tmp_path / "room.xyz")}}}
    for size in (1024, "metric"):
        data = {"scene_set": "mine", "make": "cloud", "size": size}
        config = {
            "results": str(tmp_path / "out"),
            "scene_sets": scenes,
            "datasets": {"room": data},
        }
        Plan(checked(config), check_scenes=True)
        assert len(caplog.records) == (size == "metric")


def test_points_that_are_left_out_are_counted(tmp_path: Path) -> None:
    for name, missing in (("a", 7), ("b", 11), ("c", 0)):
        points = np.random.default_rng(0).random((100, 4)) + 1
        points[:missing, :3] = np.nan
        np.save(tmp_path / f"{name}.npy", points)
    scenes = {"mine": {"loader": "point_clouds", "options": {"path": str(tmp_path)}}}
    datasets = {"taken": {"scene_set": "mine", "make": "cloud"}}
    config = {"results": str(tmp_path / "results"), "scene_sets": scenes, "datasets": datasets}
    points_line, attributes_line = left_out_lines(
        Plan(checked(config), check_scenes=True).left_out_rows()
    )
    assert points_line == "left out: taken: 18 points that are missing returns or not finite"
    assert attributes_line == "left out: taken: intensity: codecs code coordinates only"


def test_a_scene_is_looked_at_again_when_its_unit_changes(meshes: Path) -> None:
    (meshes / "torn.off").unlink()
    (meshes / "solid.off").unlink()
    with pytest.raises(InputError, match="no free position"):
        _scaled_plan(meshes, 0.1)
    assert _scaled_plan(meshes, 1.0).clouds == (("scanned", "room"),)


def _scaled_plan(meshes: Path, unit: float) -> Plan:
    options = {"path": str(meshes), "metres_per_unit": unit}
    scenes = {"mine": {"loader": "mesh_files", "options": options}}
    data = {"scanned": {"scene_set": "mine", "make": "scan"}}
    config = {"results": str(meshes.parent / "results"), "scene_sets": scenes, "datasets": data}
    return Plan(checked(config), check_scenes=True)

"""Labels of virtual scans are the classes of the objects that the rays hit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import read_cloud
from cloud_files.meshes import write_mesh
from pointkit.errors import InputError
from pointkit.geometry.mesh import Labels, Mesh, Primitive, SceneObject
from puckbench.geometry.labels import class_labels, scene_classes
from puckbench.steps.prepare_returns import PrepareReturns
from puckbench.steps.scan import Scan

SPIN = {"preset": "spin", "rotation_hz": 10, "frames_per_second": 10, "duration_s": 0.1}


def floor_and_walls() -> Mesh:
    """A floor of 8 m x 8 m at z = 0, and four walls of 3 m; two objects are walls."""
    low = np.array([[-4, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0]], float)
    vertices = np.vstack([low, low + np.array([0, 0, 3])])
    walls = [[i, (i + 1) % 4, 4 + (i + 1) % 4] for i in range(4)]
    walls += [[i, 4 + (i + 1) % 4, 4 + i] for i in range(4)]
    triangles = np.array([[0, 1, 2], [0, 2, 3], *walls])
    objects = (
        SceneObject("wall_1", "wall"),
        SceneObject("floor_1", "floor"),
        SceneObject("w", "wall"),
    )
    numbers = np.array([1, 1, *[0, 2] * 4], np.int32)
    labels = Labels(numbers, np.zeros(10, np.int32), objects, (Primitive("plane", {}),))
    return Mesh(vertices, triangles, labels)


def test_points_have_the_classes_of_the_surfaces_on_which_they_lie(tmp_path: Path) -> None:
    mesh, table = tmp_path / "box.ply", tmp_path / "box.parquet"
    write_mesh(mesh, floor_and_walls(), {"name": "box", "origin": [0.0, 0.0, 0.8]})
    sweep = {**SPIN, "azimuth_step_deg": 2.0}
    Scan(sweep=sweep, errors="vlp16", seed=1).run(mesh, table)
    files = {name: tmp_path / f"made.{name}" for name in ("ply", "parquet")}
    PrepareReturns().run(
        table, mesh.with_suffix(".json"), files["ply"], files["parquet"], tmp_path / "true.ply"
    )
    cloud, true = read_cloud(files["ply"]), read_cloud(tmp_path / "true.ply")
    numbers, names, label_set = class_labels(cloud)
    assert (names, label_set) == (("floor", "wall"), "scene")
    on_floor = np.abs(true.xyz[:, 2] + 0.8) < 1e-6
    assert 0 < on_floor.sum() < len(true)
    np.testing.assert_array_equal(np.array(names)[numbers] == "floor", on_floor)


def test_descriptions_that_do_not_fit_are_refused() -> None:
    classes = scene_classes({"objects": [{"name": "a", "semantic": "wall"}]})
    assert classes is not None
    assert classes.of(np.array([0, -1], np.int32)).tolist() == [0, -1]
    with pytest.raises(InputError, match="object 3: the scene's description lists 1"):
        classes.of(np.array([3], np.int32))
    assert scene_classes(json.loads('{"name": "no labels"}')) is None

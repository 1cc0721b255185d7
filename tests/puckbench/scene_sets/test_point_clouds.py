"""A user's own clouds and meshes, named by files, folders and patterns."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from cloud_files.clouds import read_cloud, write_cloud
from pointkit.errors import InputError
from pointkit.files import read_json
from pointkit.geometry.cloud import PointCloud
from puckbench.geometry.scaling import origin_shift
from puckbench.planning.config import checked
from puckbench.planning.plan import Plan
from puckbench.planning.workflow import Workflow
from puckbench.scene_sets.registry import open_scene_set
from puckbench.scene_sets.user_files import scene_names
from puckbench.steps.prepare import Prepare
from puckbench.steps.scene import WriteScene

RNG = np.random.default_rng(3)
POINTS = RNG.random((60, 3))


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with clouds of one name in two folders, and with a mesh."""
    monkeypatch.chdir(tmp_path)
    for folder in ("mine/north", "mine/south"):
        Path(folder).mkdir(parents=True)
        np.savetxt(f"{folder}/a.xyz", POINTS)
    np.save("mine/b.npy", POINTS)
    trimesh.creation.box((5, 4, 3)).export("mine/box.ply")
    return tmp_path


def clouds(path: Any, **options: Any) -> Any:
    return open_scene_set("point_clouds", {"path": path, **options})


@pytest.mark.usefixtures("mine")
def test_folders_patterns_and_lists_name_files() -> None:
    assert clouds("mine").names() == ["b", "north-a", "south-a"]
    assert clouds(["mine/*/a.xyz"]).names() == ["north-a", "south-a"]
    assert clouds(["mine/b.npy", "mine/north/a.xyz"]).names() == ["a", "b"]
    assert clouds({"first": "mine/b.npy"}).load("first").about["source"] == "b.npy"
    assert open_scene_set("mesh_files", {"path": "mine"}).names() == ["box"]
    scene = open_scene_set("mesh_files", {"path": "mine", "metres_per_unit": 0.5}).load("box")
    assert scene.mesh is not None
    assert np.ptp(scene.mesh.vertices, axis=0).tolist() == [2.5, 2, 1.5]


def test_files_of_one_name_have_different_names() -> None:
    names = ["a/x.ply", "a/x.las", "b/x.ply", "b/X.ply", "y y.ply"]
    result = scene_names(map(Path, names))
    assert result == ["a-x_ply", "a-x_las", "b-x_ply", "b-X_ply_2", "y_y"]


@pytest.mark.usefixtures("mine")
@pytest.mark.parametrize(
    ("path", "fault"),
    [
        ("none.ply", r"none\.ply: no such file"),
        ("mine/*.las", r"mine/\*\.las: no such file"),
        ("mine/north", None),
        (["mine/b.npy", "mine/../mine/b.npy"], r"b\.npy: the file is named twice"),
        ([], "no point clouds named"),
        ({"a b": "mine/b.npy"}, "'a b' is not a valid file name"),
    ],
)
def test_what_cannot_be_listed_is_named(path: Any, fault: str | None) -> None:
    if fault is None:
        assert clouds(path).names() == ["a"]
    else:
        with pytest.raises(InputError, match=fault):
            clouds(path).names()


def plan(**top: Any) -> Plan:
    scenes = {"mine": {"loader": "point_clouds", "options": {"path": "mine"}}}
    datasets = {"mine": {"scene_set": "mine", "make": "cloud"}}
    planned = Plan(checked({"scene_sets": scenes, "datasets": datasets, **top}), check_scenes=True)
    planned.memory.save()
    return planned


@pytest.mark.usefixtures("mine")
def test_clouds_that_cannot_be_used_are_left_out_and_named() -> None:
    Path("mine/empty.xyz").touch()
    np.save("mine/nan.npy", np.vstack([POINTS, [np.nan, 0, 0]]))
    np.save("mine/one.npy", np.ones((4, 3)))
    Path("mine/torn.las").write_bytes(b"LASF")
    planned = plan()
    assert [cloud for _, cloud in planned.clouds] == ["b", "north-a", "south-a"]
    assert planned.datasets["mine"].points == 60
    faults = planned.left_out["mine"]
    assert "empty.xyz: the cloud is empty" in faults["empty"]
    assert "1 of 61 points are not finite" in faults["nan"]
    assert "all its points are the same" in faults["one"]
    assert "torn.las: not a readable LAS file" in faults["torn"]
    with pytest.raises(InputError, match=r"^datasets.mine: scene empty: .*empty"):
        plan(strict=True)


@pytest.mark.usefixtures("mine")
def test_a_cloud_is_read_again_where_it_changed_or_was_at_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    np.save("mine/nan.npy", np.vstack([POINTS, [np.nan, 0, 0]]))
    plan()
    read: list[str] = []
    loader = type(clouds("mine"))
    whole = loader.load
    monkeypatch.setattr(loader, "load", lambda self, name: read.append(name) or whole(self, name))
    plan()
    assert read == ["nan"]
    np.save("mine/b.npy", POINTS[:50])
    plan()
    assert read == ["nan", "b", "nan"]


@pytest.mark.usefixtures("mine")
def test_points_that_are_not_finite_are_dropped_where_that_is_asked_for() -> None:
    np.savez("mine/nan.npz", xyz=np.vstack([[np.nan, 0, 0], POINTS]), intensity=np.arange(61))
    scene = clouds("mine/nan.npz", drop_invalid=True).load("nan")
    assert scene.about["dropped_points"] == 1
    assert scene.cloud.fields["intensity"].tolist() == list(range(1, 61))


@pytest.mark.usefixtures("mine")
def test_a_scenes_job_does_not_change_with_the_other_files() -> None:
    def record() -> str:
        scenes = {"mine": {"loader": "point_clouds", "options": {"path": "mine"}}}
        datasets = {"mine": {"scene_set": "mine", "make": "cloud"}}
        workflow = Workflow({"scene_sets": scenes, "datasets": datasets})
        return workflow.step("scene", scene_set="mine", scene="b").settings

    before = record()
    np.save("mine/c.npy", POINTS)
    assert record() == before


def prepared_again(source: Path, name: str, size: int | str) -> PointCloud:
    """The cloud in a file, prepared as the step does with points that no scan measured."""
    cloud, truth = source.with_name(f"{name}.ply"), source.with_name(f"{name}_truth.ply")
    Prepare(size=size, crop="none").run(source, source.with_suffix(".json"), cloud, truth)
    return read_cloud(cloud)


def test_surveyed_coordinates_come_back_bit_for_bit(tmp_path: Path) -> None:
    utm = RNG.random((500, 3)) * [90, 70, 12] + [698_234.0, 5_337_911.0, -3.0]
    utm[0] = [698_234.001, 5_337_911.123456789, 1e-9]
    colours = RNG.integers(0, 256, (500, 3)).astype(np.uint8)
    fields = {"intensity": np.arange(500, dtype=np.uint16)}
    write_cloud(tmp_path / "utm.ply", PointCloud(utm, colours=colours, fields=fields), False)
    options = {"path": str(tmp_path / "utm.ply")}
    WriteScene(loader="point_clouds", name="utm", options=options).run(tmp_path / "scene.ply")
    prepared = prepared_again(tmp_path / "scene.ply", "cloud", "metric")
    assert read_json(tmp_path / "cloud.json")["offset"] == [698_234.0, 5_337_911.0, 0.0]
    assert np.abs(prepared.xyz).max() < 100
    assert np.array_equal(prepared.to_metres(prepared.xyz), utm)
    assert np.array_equal(prepared.fields["intensity"], fields["intensity"])
    assert np.array_equal(prepared.colours, colours)
    # Prepared again, it is the same cloud; scaled to a cube, no point has moved by half a step.
    again = prepared_again(tmp_path / "cloud.ply", "again", "metric")
    assert np.array_equal(again.xyz, prepared.xyz)
    scaled = prepared_again(tmp_path / "scene.ply", "scaled", 1024)
    step_m = 2.0**-16 / scaled.about["scale"]
    assert np.abs(scaled.to_metres(scaled.xyz) - utm).max() < 0.5 * step_m + 2e-9


@pytest.mark.parametrize("low", [-6e6, -1e3 - 1, -20.0, 0.1, 900.0, 5e5, 1e12])
def test_a_shift_loses_nothing(low: float) -> None:
    points = RNG.random((2000, 3)) * [1e-3, 300.0, 1e5] + low
    points[0] = low  # the nearest, if they are positive
    shift = origin_shift(points)
    assert np.array_equal((points - shift) + shift, points)
    assert (shift == np.trunc(shift)).all()
    assert shift.any() == (abs(low) > 1000)


@pytest.mark.usefixtures("mine")
def test_compressed_clouds_are_named_and_read_like_others() -> None:
    text = Path("mine/north/a.xyz").read_bytes()
    Path("mine/c.xyz.gz").write_bytes(gzip.compress(text))
    Path("mine/north/a.txt.gz").write_bytes(gzip.compress(text))
    result = clouds("mine")
    assert result.names() == ["b", "c", "north-a_txt", "north-a_xyz", "south-a"]
    scene = result.load("c")
    assert np.array_equal(scene.cloud.xyz, POINTS)
    assert scene.about["format"] == "xyz"
    assert clouds("mine/c.xyz.gz").names() == ["c"]


@pytest.mark.usefixtures("mine")
def test_missing_returns_and_columns_of_frames_are_options() -> None:
    np.save("mine/zeros.npy", np.vstack([POINTS + 1, np.zeros((9, 3))]))
    scene = clouds("mine/zeros.npy").load("zeros")
    assert len(scene.cloud) == 60
    assert scene.about["missing_returns"] == scene.about["dropped_points"] == 9
    assert len(clouds("mine/zeros.npy", keep_missing=True).load("zeros").cloud) == 69
    POINTS.astype("<f4").tofile("mine/unit.bin")
    with pytest.raises(InputError, match="values each"):
        clouds("mine/unit.bin").load("unit")
    assert len(clouds("mine/unit.bin", bin_columns="x,y,z").load("unit").cloud) == 60

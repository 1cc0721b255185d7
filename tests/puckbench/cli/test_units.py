"""Files in another unit than the metre: named, brought to metres, and remarked upon where not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from cloud_files.clouds import read_cloud
from pointkit.errors import InputError
from pointkit.geometry.mesh import Labels, Mesh, Primitive, SceneObject, scaled_mesh
from puckbench.cli import main
from puckbench.planning.user_files import UserRun
from puckbench.scene_sets.registry import open_scene_set

GRID = np.random.default_rng(2).integers(0, 4000, (1500, 3))
"""Points of a room, in whole millimetres."""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A room as clouds in millimetres and in metres, and a box as meshes of both."""
    monkeypatch.chdir(tmp_path)
    np.savetxt("mm.xyz", GRID, fmt="%d")
    np.savetxt("m.xyz", GRID / 1000, fmt="%.3f")
    room = trimesh.creation.box((5, 4, 3))
    room.invert()
    room.export("m.off")
    room.apply_scale(1000)
    room.export("mm.off")
    return tmp_path


def answer(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[dict[str, Any], str]:
    """What a command prints: its answer, and its remarks."""
    capsys.readouterr()
    status = main([*map(str, words), "--json"])
    captured = capsys.readouterr()
    assert status == 0, captured.err
    return json.loads(captured.out), captured.err


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    capsys.readouterr()
    assert main([*map(str, words)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said


def row(capsys: pytest.CaptureFixture[str], cloud: str, *unit: str) -> dict[str, Any]:
    """Bytes and distances in metres of a cloud that is prepared in metres and coded."""
    answer(capsys, "prepare", cloud, "ready.ply", "--scale", 0, *unit)
    coded, _ = answer(capsys, "encode", "ready.ply", "s.bin", "--codec", "draco", "--rate", "r6")
    measured, _ = answer(capsys, "evaluate", "ready.ply", "s.bin")
    return {"bytes": coded["bytes"], **{k: v for k, v in measured.items() if k.startswith("d1")}}


def test_a_cloud_gives_the_same_row_in_millimetres_and_in_metres(
    capsys: pytest.CaptureFixture[str],
) -> None:
    metres = row(capsys, "m.xyz")
    millimetres = row(capsys, "mm.xyz", "--metres-per-unit", "0.001")
    assert millimetres["bytes"] == metres["bytes"]
    assert {name for name in metres if name.startswith("d1")}
    for name, value in metres.items():
        assert millimetres[name] == pytest.approx(value, rel=1e-6), name


def test_a_mesh_in_millimetres_is_sampled_and_scanned_in_metres(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for words in (("sample", "--points", 500), ("scan", "--sweep", '{"duration_s": 0.05}')):
        command, *options = words
        end = {"sample": "ply", "scan": "parquet"}[command]
        answer(capsys, command, "m.off", f"m.{end}", *options)
        answer(capsys, command, "mm.off", f"mm.{end}", *options, "--metres-per-unit", "0.001")
    drawn = read_cloud(Path("mm.ply")).xyz
    assert np.ptp(drawn, axis=0) == pytest.approx([5, 4, 3], rel=0.05)
    from virtual_lidar.scan_table import read_scan

    scans = [read_scan(Path(f"{name}.parquet")) for name in ("m", "mm")]
    np.testing.assert_allclose(scans[1].xyz, scans[0].xyz, atol=1e-9)


def test_an_extent_that_speaks_for_millimetres_is_remarked_upon(
    capsys: pytest.CaptureFixture[str],
) -> None:
    spans = "spans {} m: if its unit is not the metre, name it (--metres-per-unit 0.001: mill"
    _, said = answer(capsys, "prepare", "mm.xyz", "ready.ply", "--scale", 0)
    assert said.startswith(f"puckbench: mm.xyz: {spans.format(np.ptp(GRID, axis=0).max())}")
    _, said = answer(capsys, "scan", "mm.off", "s.parquet", "--sweep", '{"duration_s": 0.01}')
    assert f"puckbench: mm.off: {spans.format(5000)}" in said
    for words in (
        ("prepare", "mm.xyz", "ready.ply"),  # scaled to a cube: its unit does not matter
        ("prepare", "m.xyz", "ready.ply", "--scale", 0),
        ("scan", "m.off", "s.parquet", "--sweep", '{"duration_s": 0.01}'),
    ):
        assert answer(capsys, *words)[1] == ""


@pytest.mark.parametrize(
    ("extent", "remarked"), [(0.049, True), (0.05, False), (1000.0, False), (1000.5, True)]
)
def test_extents_are_plausible_from_5_cm_to_1_km_wherever_they_lie(
    extent: float, remarked: bool, caplog: pytest.LogCaptureFixture
) -> None:
    from puckbench.geometry.extent import warn_of_implausible_extent

    corner = np.array([512_000.0, 5_400_000.0, 300.0])
    low, high = np.zeros(3), np.array([0.0, extent, extent / 2])
    if extent > 1:
        low, high = low + corner, high + corner
    warn_of_implausible_extent(Path("a.ply"), np.stack([low, high]))
    assert bool(caplog.records) == remarked
    warn_of_implausible_extent(Path("survey.LAZ"), np.stack([low, high]))
    assert len(caplog.records) == remarked


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (("prepare", "mm.xyz", "r.ply", "--metres-per-unit", "0"), "'0' is not a number above 0"),
        (("prepare", "mm.xyz", "r.ply", "--metres-per-unit", "inf"), "is not a number above 0"),
        (("sample", "mm.off", "r.ply", "--metres-per-unit", "mm"), "'mm' is not a number above 0"),
        (("run", "mm.xyz", "--metres-per-unit", "mm"), "'mm' is neither a single number nor FILE="),
        (("run", "mm.xyz", "--metres-per-unit", "0.1", "1"), "'0.1' is neither a single number"),
        (("run", "mm.xyz", "--metres-per-unit", "=1"), "'=1' is neither a single number nor FILE="),
        (("run", "mm.xyz", "--metres-per-unit", "mm.xyz=a"), "'mm.xyz=a' is neither a"),
        (("run", "mm.xyz", "--metres-per-unit", "a=1", "a=2"), "'a' is given twice"),
        (("run", "mm.xyz", "--metres-per-unit", "nm.xyz=1"), "no cloud or mesh 'nm.xyz'; did you"),
        (("run", "mm.xyz", "--metres-per-unit", "mm.xyz=-1"), "must be greater than 0"),
    ],
)
def test_a_unit_that_is_none_is_refused(
    words: tuple[str, ...], fault: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(capsys, *words)
    assert fault in said
    assert "metres" in said
    assert not Path("out/config.yaml").exists()


@pytest.mark.parametrize("turns", [(), ("--turns", "0")])
@pytest.mark.parametrize("option", [("--metres-per-unit", "0.001"), ("--drop-invalid",)])
def test_options_of_clouds_are_refused_for_scans(
    option: tuple[str, ...], turns: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    if not Path("s.parquet").exists():
        answer(capsys, "scan", "m.off", "s.parquet", "--sweep", '{"duration_s": 0.01}')
    said = refused(capsys, "prepare", "s.parquet", "r.ply", *turns, *option)
    assert f"{option[0]}: is for clouds, not for scans, recordings (s.parquet)" in said


def test_units_of_some_files_go_to_their_sets() -> None:
    units = {"mm.xyz": 0.001, "mm.off": 0.002}
    config = UserRun(
        ("m.xyz", "mm.xyz", "mm.off"), ("draco",), "out", options={"metres_per_unit": units}
    )
    scenes = config.configuration()["scene_sets"]
    assert scenes["clouds"]["options"]["metres_per_unit"] == {"mm.xyz": 0.001}
    assert scenes["meshes"]["options"]["metres_per_unit"] == {"mm.off": 0.002}


def test_a_number_holds_for_all_files() -> None:
    clouds = open_scene_set("point_clouds", {"path": ["m.xyz", "mm.xyz"], "metres_per_unit": 0.5})
    for name, points in (("m", GRID / 1000), ("mm", GRID)):
        np.testing.assert_allclose(clouds.load(name).cloud.xyz, points / 2, atol=1e-9)
        assert clouds.options_of(name)["metres_per_unit"] == 0.5


def test_a_table_of_units_holds_for_the_files_that_it_names() -> None:
    Path("sub").mkdir()
    Path("sub/mm.xyz").write_bytes(Path("mm.xyz").read_bytes())
    clouds = open_scene_set(
        "point_clouds",
        {"path": ["m.xyz", "mm.xyz", "sub/mm.xyz"], "metres_per_unit": {"sub/mm.xyz": 0.001}},
    )
    spans = {name: np.ptp(clouds.load(name).cloud.xyz) for name in clouds.names()}
    assert spans["sub-mm"] == pytest.approx(spans["m"])
    assert spans["mm"] == pytest.approx(1000 * spans["m"])
    assert clouds.load("sub-mm").about["metres_per_unit"] == 0.001
    assert "metres_per_unit" not in clouds.load("m").about
    assert clouds.options_of("sub-mm")["metres_per_unit"] == 0.001
    assert clouds.options_of("m")["metres_per_unit"] == 1


@pytest.mark.parametrize("loader", ["point_clouds", "mesh_files"])
def test_a_table_that_names_no_file_is_refused(loader: str) -> None:
    scenes = open_scene_set(loader, {"path": ".", "metres_per_unit": {"nm.off": 0.001}})
    with pytest.raises(InputError, match=r"metres_per_unit: no cloud or mesh 'nm.off'"):
        scenes.names()


def test_a_folder_of_meshes_takes_a_table() -> None:
    scenes = open_scene_set("mesh_files", {"path": ".", "metres_per_unit": {"mm.off": 0.001}})
    boxes = [scenes.load(name).mesh.bounds() for name in ("m", "mm")]
    np.testing.assert_allclose(boxes[0], boxes[1], rtol=1e-12)


def test_primitives_of_labels_are_brought_to_metres_too() -> None:
    ids = np.zeros(1, dtype=np.int32)
    sphere = Primitive("sphere", {"centre": [1000, 0, 0], "radius": 500.0})
    plane = Primitive("plane", {"normal": [0, 0, 1], "offset": 2000.0})
    labels = Labels(ids, ids, (SceneObject("a", "a"),), (sphere, plane))
    mesh = Mesh(np.eye(3) * 1000, np.array([[0, 1, 2]]), labels)
    scaled = scaled_mesh(mesh, 0.001)
    assert scaled.labels is not None
    assert scaled.vertices.tolist() == np.eye(3).tolist()
    assert scaled.labels.primitives[0].parameters == {"centre": [1, 0, 0], "radius": 0.5}
    assert scaled.labels.primitives[1].parameters["offset"] == 2
    assert scaled_mesh(mesh, 1.0).labels is labels

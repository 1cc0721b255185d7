"""Places where a sensor cannot stand, and those that only look like it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from cloud_files.meshes import write_mesh
from puckbench.cli import main
from tests.support.sensor_scenes import quad, room


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["--origin", "-1", "2", "1"], "the sensor at [-1.0, 2.0, 1.0] is outside the scene: "),
        (["--origin", "0", "2", "1"], "the sensor at [0.0, 2.0, 1.0] touches the mesh"),
        (["--origin", "0", "2", "1", "--anywhere"], "the sensor at [0.0, 2.0, 1.0] touches"),
        (["--origin", "900", "2", "1", "--anywhere"], "no ray returned to a sensor at [900.0,"),
        (["--origin", "nan", "2", "1"], "origin.0 is nan, but must be a finite number"),
        (["--sweep", '{"max_range_m": 0.1}'], "no ray returned to a sensor at"),
        (["--sensor", "half.yaml"], "half.yaml: 2 vertical_correction_mm for 3 lasers"),
        (["--height", "7"], "no free position 7.0 m above its floor"),
    ],
)
def test_on_the_command_line_it_is_one_line_status_2_and_no_file(
    words: list[str],
    fault: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    write_mesh(Path("room.ply"), replace(room(), labels=None))
    Path("half.yaml").write_text(
        "{name: half, laser_elevation_deg: [-1, 0, 1], vertical_correction_mm: [1, -1],"
        " rotation_hz: 10, azimuth_step_deg: 0.2, max_range_m: 30}"
    )
    assert main(["scan", "room.ply", "o.parquet", *words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert fault in error
    assert not Path("o.parquet").exists()


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "every face of the mesh has zero area"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "m.obj: "),
        ("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "a face has a vertex that is not finite"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "m.obj: "),
    ],
)
def test_a_degenerate_mesh_is_one_line(
    text: str, fault: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "m.obj").write_text(text)
    assert main(["scan", str(tmp_path / "m.obj"), str(tmp_path / "o.parquet")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert fault in error
    assert [path.name for path in tmp_path.iterdir()] == ["m.obj"]


def test_an_open_scene_is_scanned_from_a_place_that_is_meant(tmp_path: Path) -> None:
    """A yard: ground alone, seen by less than half of all directions."""
    mesh, out = tmp_path / "yard.ply", tmp_path / "o.parquet"
    write_mesh(mesh, quad([-20, -20, 0], [40, 0, 0], [0, 40, 0]))
    words = ["scan", str(mesh), str(out), "--sweep", '{"preset": "spin"}']
    assert main(words) == 2
    assert main([*words, "--anywhere"]) == 0
    assert main([*words, "--origin", "3", "4", "1.5"]) == 2
    assert main([*words, "--origin", "3", "4", "1.5", "--anywhere"]) == 0


def test_a_place_that_the_scenes_description_names_is_taken(tmp_path: Path) -> None:
    mesh, out = tmp_path / "yard.ply", tmp_path / "o.parquet"
    write_mesh(mesh, quad([-20, -20, 0], [40, 0, 0], [0, 40, 0]))
    mesh.with_suffix(".json").write_text(json.dumps({"puckbench": "mesh", "origin": [1, 2, 1.5]}))
    assert main(["scan", str(mesh), str(out), "--sweep", '{"preset": "spin"}']) == 0
    mesh.with_suffix(".json").write_text(json.dumps({"puckbench": "mesh", "origin": "somewhere"}))
    assert main(["scan", str(mesh), str(out)]) == 2
    mesh.with_suffix(".json").write_text(json.dumps([1, 2, 3]))
    assert main(["scan", str(mesh), str(out), "--anywhere", "--sweep", '{"preset": "spin"}']) == 0

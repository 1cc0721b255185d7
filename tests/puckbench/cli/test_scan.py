"""Scans and exports by hand: every format of meshes, sensor, error model, format of clouds."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from cloud_files.meshes import write_mesh
from pointkit.lidar.sensors import sensor_names
from puckbench.cli import main
from puckbench.recordings.export import FORMATS
from tests.support.sensor_scenes import room
from virtual_lidar import error_model_names, read_scan

TURN = json.dumps({"preset": "spin", "azimuth_step_deg": 2.0})
FORMATS_OF_MESHES = ("obj", "off", "stl", "glb", "ply")
OPTIONS: dict[str, dict[str, Any]] = {
    "none": {"receiver": {"range_quantum_mm": 2}},
    "vlp16": {"bias_redrawn": "scan", "ray_distribution": "laplace", "ray_mean_m": 0.01},
    "vlp16_divergence": {"yaw_width_deg": 0.3, "returns_along": "nominal"},
    "vlp16_incidence": {"incidence_factor": 0.2},
    "distance_table": {"table": [[1, 0, 0.01], [5, 0.01, 0.02]], "distribution": "laplace"},
    "surface_normal": {"normal_sigma_m": 0.02, "ray_sigma_m": 0.01},
    "calibrated": {"ray_sigma_m": 0.007, "frame_sigma_m": 0.004},
    "beam_footprint": {"sub_rays": 5, "returns": "mean", "merged_within_m": 0.5},
}


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    write_mesh(tmp_path / "room.ply", replace(room(), labels=None))
    return tmp_path / "room.ply"


def scanned(mesh: Path, *words: str) -> Any:
    out = mesh.parent / "scan.parquet"
    assert main(["scan", str(mesh), str(out), "--sweep", TURN, *words]) == 0
    return read_scan(out)


@pytest.mark.parametrize("kind", FORMATS_OF_MESHES)
def test_a_mesh_of_any_format_gives_the_same_scan(kind: str, mesh: Path) -> None:
    expected = scanned(mesh, "--origin", "3", "2", "1.2")
    solid = trimesh.Trimesh(room().vertices, room().triangles, process=False)
    if kind == "glb":
        solid.apply_transform([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    other = mesh.with_name(f"other.{kind}")
    solid.export(other)
    table = scanned(other, "--origin", "3", "2", "1.2")
    assert table.xyz == pytest.approx(expected.xyz, abs=1e-5)


@pytest.mark.parametrize("sensor", sensor_names())
def test_every_sensor_sweeps_its_own_elevations(sensor: str, mesh: Path) -> None:
    table = scanned(mesh, "--sensor", sensor)
    assert len(table) == 180 * len(table.about["sensor"]["laser_elevation_deg"])
    result = np.degrees(table["pitch"][: len(np.unique(table["laser_id"]))])
    assert result == pytest.approx(table.about["sensor"]["laser_elevation_deg"])


def test_a_users_own_sensor_is_a_file(mesh: Path) -> None:
    own = mesh.with_name("own.yaml")
    own.write_text(
        "{name: three, laser_elevation_deg: [-20, 0, 20], rotation_hz: 10, azimuth_step_deg: 1,"
        " max_range_m: 30, firing_sequence_us: 277.8, firing_interval_us: 50}"
    )
    assert len(scanned(mesh, "--sensor", str(own))) == 180 * 3
    assert scanned(mesh, "--sensor", str(own)).about["sensor"]["name"] == "three"


@pytest.mark.parametrize("errors", error_model_names())
def test_every_error_model_takes_its_options(errors: str, mesh: Path) -> None:
    options = OPTIONS.get(errors, {})
    words = ["--errors", errors, "--error-options", json.dumps(options), "--seed", "3"]
    table = scanned(mesh, *words)
    assert len(table) == 180 * 16
    description = table.about["errors"]
    assert {name: description[name] for name in options if name != "receiver"} == {
        name: value for name, value in options.items() if name != "receiver"
    }
    assert not np.array_equal(table["distance"], table["distance_noisy"])


def test_export_knows_every_format(mesh: Path) -> None:
    scanned(mesh, "--errors", "vlp16")
    for suffix in FORMATS:
        out = mesh.with_name(f"scan{suffix}")
        assert main(["export", str(mesh.with_name("scan.parquet")), str(out)]) == 0
        assert out.stat().st_size > 180 * 16


def test_a_sweep_that_is_no_json_is_bad_usage(
    mesh: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["scan", str(mesh), str(mesh.with_name("o.parquet")), "--sweep", "{4 s}"]
    assert main(words) == 2
    assert "argument --sweep: not JSON: {4 s}" in capsys.readouterr().err

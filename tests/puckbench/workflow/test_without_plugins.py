"""Puckbench where no package adds plug-ins: it plans, runs, draws and reports by itself."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml

from cloud_files.clouds import write_cloud
from pointkit.geometry.cloud import PointCloud
from tests.support.without_plugins import python_without_plugins

OWN_FIGURES = {
    *("medians_per_rate", "chamfer_rd", "hausdorff_rd", "encoding_time", "decoding_time"),
    *("sampled_object", "point_counts", "elongation", "spread"),
}


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return python_without_plugins(tmp_path_factory.mktemp("environment"))


def called(python: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        [python, "-m", *words], cwd=folder, env=env, capture_output=True, text=True, check=False
    )


def test_a_run_draws_puckbenchs_own_figures(python: Path, tmp_path: Path) -> None:
    points = np.random.default_rng(0).random((3000, 3))
    write_cloud(tmp_path / "cube.ply", PointCloud(points))
    words = ("cube.ply", "--codecs", "draco", "--frame", "scaled", "--cores", "2")
    done = called(python, tmp_path, "puckbench", "run", *words)
    assert done.returncode == 0, done.stderr[-4000:]
    drawn = {file.stem for file in (tmp_path / "out" / "figures").glob("*.png")}
    assert drawn == OWN_FIGURES
    first = {file.name for file in (tmp_path / "out" / "first_look").glob("*.png")}
    assert first == {"chamfer_rd.png", "decoding_time.png"}
    page = (tmp_path / "out" / "report.html").read_text()
    assert all(f'id="figure-{name}"' in page for name in OWN_FIGURES)
    again = called(python, tmp_path, "puckbench", "figure", "fig_6_6", "a.png", "--inputs", "{}")
    assert again.returncode == 2
    assert again.stderr.startswith("puckbench: unknown figure 'fig_6_6' (")
    assert again.stderr.count("\n") == 1


def test_help_lists_the_commands_of_puckbench_alone(python: Path, tmp_path: Path) -> None:
    done = called(python, tmp_path, "puckbench", "--help")
    assert done.returncode == 0, done.stderr
    assert "report" in done.stdout
    assert "claims" not in done.stdout
    done = called(python, tmp_path, "puckbench", "report", "--help")
    assert done.returncode == 0, done.stderr


def test_a_sensor_study_needs_a_package_that_measures_it(python: Path, tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text(
        yaml.safe_dump({"scene_sets": {}, "datasets": {}, "sensor_study": {}})
    )
    done = called(python, tmp_path, "puckbench", "run", "config.yaml")
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    line = done.stderr.splitlines()[-1]
    assert line.startswith("puckbench: sensor_study: no installed package measures it")

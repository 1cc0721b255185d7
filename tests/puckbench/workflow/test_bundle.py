"""A run is published as a bundle, which another folder verifies and repeats to the same bytes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from puckbench.cli import main
from puckbench.planning.study_run import study_configuration
from puckbench.report.reference_results import read_reference
from puckbench.results.bundles import CONFIGURATION, read_bundle, write_bundle
from tests.support.bench import RAW_CODEC, ROOT, Bench

FACTOR = 'json.loads((Path(__file__).parent / "unit.json").read_text()) * scale.ONE'
CODEC = f"""import json
from pathlib import Path

import scale
{RAW_CODEC.replace('self.rates[rate]["step"]', f'self.rates[rate]["step"] / ({FACTOR})')}"""
"""A codec that reads a file beside it, and imports a module that lies in a folder of its own."""
CONFIG: dict[str, Any] = {
    "scene_sets": {"files": {"loader": "point_clouds", "options": {"path": "clouds"}}},
    "datasets": {"mine": {"scene_set": "files", "make": "cloud"}},
    "codecs": {
        "draco": {"rates": ["r1", "r4"]},
        "raw_grid": {
            "class": "raw_grid.py:Raw",
            "rates": {"r1": {"step": 4.0}, "r2": {"step": 1.0}},
        },
    },
    "sensor_study": None,
    "figures": {"examples": {"object": "mine/a"}},
}


def puckbench(folder: Path, *words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "puckbench", *map(str, words)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{folder / 'lib'}"},
        capture_output=True,
        text=True,
        check=False,
    )


def write_run(folder: Path, clouds: str = "clouds") -> Bench:
    """Write a configuration with two codecs, one of which is the user's, and a cloud."""
    folder.mkdir(exist_ok=True)
    bench = Bench(folder)
    place = folder / clouds
    place.mkdir(exist_ok=True)
    np.savetxt(place / "a.xyz", np.random.default_rng(5).random((600, 3)), fmt="%.6f")
    (folder / "raw_grid.py").write_text(CODEC)
    (folder / "unit.json").write_text("1")
    (folder / "lib").mkdir(exist_ok=True)
    (folder / "lib" / "scale.py").write_text("ONE = 1\n")
    bench.configure({**CONFIG, "scene_sets.files.options.path": clouds})
    return bench


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """A folder with a finished run and its bundle ``a.zip``."""
    bench = write_run(tmp_path_factory.mktemp("author") / "work")
    done = puckbench(bench.folder, "run", "config.yaml", "--cores", "2")
    assert done.returncode == 0, done.stderr[-4000:]
    words = ("bundle", "results", "--config", "config.yaml", "--to", "a.zip", "--streams")
    done = puckbench(bench.folder, *words)
    assert done.returncode == 0, done.stderr[-4000:]
    assert "raw_grid.py" in done.stdout
    return bench


def test_equal_results_give_equal_bundles_without_paths_of_the_machine(bench: Bench) -> None:
    words = ("bundle", "results", "--config", "config.yaml", "--streams", "--json")
    done = puckbench(bench.folder, *words)
    assert done.returncode == 0, done.stderr[-4000:]
    assert json.loads(done.stdout)["file"] == "results.zip"
    first, second = ((bench.folder / name).read_bytes() for name in ("a.zip", "results.zip"))
    assert first == second
    assert str(bench.folder.parent).encode() not in first
    bundle = read_bundle(bench.folder / "a.zip")
    assert bundle.members["raw_grid.py"].decode() == CODEC
    assert {CONFIGURATION, "results/reference.parquet"} < bundle.members.keys()
    assert {"metrics", "clouds", "summary", "bd_rate"} < bundle.tables.keys()
    assert list(bundle.manifest.inputs) == ["clouds/a.xyz"]
    assert set(bundle.manifest.plugins) == {"box.py", "lib/scale.py", "raw_grid.py", "unit.json"}
    assert bundle.manifest.python_path == ("lib",)
    curve = "coded/mine/a/raw_grid"
    assert list(bundle.manifest.streams[curve]) == ["r1.bin", "r2.bin"]
    assert bundle.members[f"results/{curve}.zip"] == (bench.results / f"{curve}.zip").read_bytes()
    assert set(bundle.manifest.decoded) == {"decoded/mine/a/draco", "decoded/mine/a/raw_grid"}


@pytest.fixture
def private(bench: Bench) -> Path:
    """The bundle without streams, beside nothing else."""
    bundle = read_bundle(bench.folder / "a.zip")
    members = {n: data for n, data in bundle.members.items() if not n.startswith("results/coded")}
    path = bench.folder.parent / "small.zip"
    write_bundle(path, bundle.manifest, members)
    return path


def test_a_bundle_is_described_without_running_it(
    private: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(private.parent)
    assert main(["verify", "small.zip", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["plugins"] == ["box.py", "lib/scale.py", "raw_grid.py", "unit.json"]
    assert answer["streams"] == "4, by their digests"
    assert answer["different_here"] == []
    assert main(["verify", "small.zip"]) == 0
    assert "all agree with the manifest" in capsys.readouterr().out


def test_another_folder_repeats_the_run_to_the_same_bytes(bench: Bench, private: Path) -> None:
    there = private.parent / "reviewer"
    there.mkdir()
    lost = puckbench(there, "verify", private, "--run", "again")
    digest = read_bundle(private).manifest.inputs["clouds/a.xyz"].sha256
    assert lost.returncode == 2
    assert lost.stderr.count("\n") == 1
    assert "no file clouds/a.xyz (" in lost.stderr
    assert digest in lost.stderr
    assert not (there / "again").exists()
    (bench.folder / "clouds" / "a.xyz").rename(there / "other.xyz")
    try:
        done = puckbench(there, "verify", private, "--run", "again", "--inputs", ".", "--json")
    finally:
        (there / "other.xyz").rename(bench.folder / "clouds" / "a.xyz")
    assert done.returncode == 0, done.stderr[-4000:]
    answer = json.loads(done.stdout)
    assert answer["differences"] == []
    assert answer["verdict"].startswith("the same results")
    assert "plug-ins of the bundle that are executed: box.py, lib/scale.py" in done.stderr
    for name in ("coded/mine/a/draco", "coded/mine/a/raw_grid"):
        assert (there / "again" / "results" / f"{name}.zip").exists()
    again = puckbench(there, "verify", private, "--run", "again", "--inputs", bench.folder)
    assert (again.returncode, "again: exists" in again.stderr) == (2, True)


def test_another_plug_in_gives_other_streams_and_status_1(bench: Bench, private: Path) -> None:
    bundle = read_bundle(private)
    code = CODEC.replace("np.round(cloud.xyz /", "np.floor(cloud.xyz /")
    assert code != CODEC
    members = {**bundle.members, "raw_grid.py": code.encode()}
    write_bundle(bench.folder / "forged.zip", bundle.manifest, members)
    done = puckbench(bench.folder, "verify", "forged.zip", "--run", "forged", "--json")
    assert done.returncode == 1, done.stderr[-4000:]
    answer = json.loads(done.stdout)
    assert answer["verdict"] == "different results"
    found = {each["what"]: each["how"] for each in answer["differences"]}
    assert found["streams"] == "2 of 4 differ, first coded/mine/a/raw_grid/r1.bin"
    assert found["decoded clouds"].startswith("2 of 4 differ")
    assert "d1_psnr in 2 of 4 rows (by at most" in found["table metrics"]
    assert "table clouds" not in found


def test_results_of_other_code_and_of_other_settings_are_refused(bench: Bench) -> None:
    code, config = (bench.folder / name for name in ("raw_grid.py", "config.yaml"))
    kept = config.read_text()
    code.write_text(CODEC.replace('"raw 1"', '"raw 2"'))
    try:
        done = puckbench(bench.folder, "bundle", "results", "--config", "config.yaml")
    finally:
        code.write_text(CODEC)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "results: not the results of config.yaml, of which" in done.stderr
    assert "run it first (puckbench run config.yaml)" in done.stderr
    done = puckbench(bench.folder, "bundle", "clouds", "--config", "config.yaml")
    assert (done.returncode, "its results are in results" in done.stderr) == (2, True)
    done = puckbench(bench.folder, "bundle", "results")
    assert (done.returncode, "name the configuration" in done.stderr) == (2, True)
    assert config.read_text() == kept


def test_a_run_is_compared_with_a_bundle_and_two_bundles_with_each_other(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(bench.folder)
    assert main(["compare", "results", "--with", "a.zip", "--codecs", "raw_grid", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["study"] == "a"
    assert answer["same_streams"] == {"draco": [2, 2], "raw_grid": [2, 2]}
    assert answer["processors"]["run"] == answer["processors"]["study"]
    assert main(["compare", "a.zip", "--with", "results.zip", "--codecs", "raw_grid"]) == 0
    out = capsys.readouterr().out
    assert "* timed in another run" in out
    assert (bench.folder / "comparison" / "results.png").exists()
    study = study_configuration(read_reference("a.zip"), ["gpcc"], "out")
    assert study["scene_sets"]["files"]["options"] == {"path": "clouds"}
    assert list(study["codecs"]) == ["gpcc"]

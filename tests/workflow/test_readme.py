"""The examples of the README do what it says."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from puckbench.core.files import read_json
from tests.workflow.conftest import ROOT, Bench

README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """The README's code in a language."""
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def _write_blocks(folder: Path) -> None:
    """Write the README's Python files where their first lines say."""
    for block in blocks("python"):
        name = block.split('"""')[1].split(":")[0]
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(block)


def _python(folder: Path, *words: str, path: str = str(ROOT / "src")) -> str:
    """What a Python program in a folder prints, with puckbench on its path."""
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_library_compares_codecs_as_the_readme_shows(tmp_path: Path) -> None:
    _write_blocks(tmp_path)
    rng = np.random.default_rng(0)
    np.savetxt(tmp_path / "points.xyz", rng.random((500, 3)) * [1, 1, 0.01])
    lines = _python(tmp_path, "compare.py").splitlines()
    table = pd.DataFrame([line.split()[1:] for line in lines[1:]], columns=lines[0].split())
    assert list(table.codec) == ["draco"] * 8 + ["grid"] * 3
    grid = table[table.codec == "grid"].astype({"bpp": float, "d1_psnr": float})
    assert grid.bpp.is_monotonic_increasing
    # Rounding to steps of 4 errs by 4**2 / 12 along each of three axes; MPEG's peak is tripled.
    assert grid.d1_psnr.iloc[-1] == pytest.approx(10 * np.log10(3 * 1023**2 / 4), abs=0.3)


def test_a_package_brings_a_codec_as_the_readme_shows(fresh: Bench, tmp_path: Path) -> None:
    _write_blocks(tmp_path)
    (package := tmp_path / "package").mkdir()
    (tmp_path / "codecs" / "grid.py").rename(package / "grid.py")
    (package / "pyproject.toml").write_text(blocks("toml")[0])
    offline = ["--no-deps", "--no-index", "--no-build-isolation", "--disable-pip-version-check"]
    target = tmp_path / "installed"
    _python(tmp_path, "-m", "pip", "install", *offline, "--target", str(target), "./package")
    path = f"{ROOT / 'src'}{os.pathsep}{target}"
    assert "r3 step 4" in _python(tmp_path, "-m", "puckbench", "codecs", path=path)
    fresh.configure({"codecs": {"grid": {}}, "sensor_study": None, "figures": {}})
    row = "results/metrics/objects/chair_01/grid/r3.json"
    _python(fresh.folder, *fresh.command(row)[1:], path=path)
    assert read_json(fresh.folder / row)["codec_version"] == "1"


def test_a_codec_and_a_data_set_of_ones_own_run_as_the_readme_shows(fresh: Bench) -> None:
    _write_blocks(fresh.folder)
    shown = [yaml.safe_load(block) for block in blocks("yaml")]
    codecs = next(block["codecs"] for block in shown if "codecs" in block)
    scenes = next(block["scenes"] for block in shown if "spheres" in block.get("scenes", {}))
    fresh.configure(
        {
            "scenes": scenes,
            "datasets": {"spheres": {"scenes": "spheres", "make": "sample", "points": 1000}},
            "codecs": {"grid": codecs["grid"]},
            "figures": {},
            "sensor_study": None,
        }
    )
    fresh.made("tables")
    table = pd.read_csv(fresh.results / "tables" / "metrics.csv")
    assert len(table) == 3 * 3
    coarse = table[table.cloud == "coarse"].set_index("rate")
    assert coarse.bpp.is_monotonic_increasing
    assert coarse.d1_mse.is_monotonic_decreasing


def test_files_that_the_readme_names_exist() -> None:
    named = set(re.findall(r"`((?:src|config|workflow|docs)/[\w./-]+)`|\]\(([\w./]+)\)", README))
    for path in {first or second for first, second in named}:
        assert (ROOT / path).exists(), path


def test_the_default_configuration_has_the_paths_that_the_readme_names() -> None:
    config = yaml.safe_load((ROOT / "config" / "config.yaml").read_text())
    assert "office_1" in config["scenes"]["rooms"]["select"]
    assert "rooms_noisy" in config["datasets"]
    assert Path(ROOT / "config" / "README.md").exists()

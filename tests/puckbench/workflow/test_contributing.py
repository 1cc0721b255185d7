"""What CONTRIBUTING.md shows can be added, from a package of its own and from files."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
import yaml

from tests.support.bench import ROOT, Bench
from tests.support.pages import blocks, write_files

PAGE = "CONTRIBUTING.md"
RUN = {"figures": {}, "sensor_study": False, "timing": {"repeats": 1}}


def _program(folder: Path, *words: str, path: str = str(ROOT / "src")) -> str:
    """What a Python program in a folder prints, with a path of its own."""
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    return done.stdout


@pytest.fixture
def installed(tmp_path: Path) -> str:
    """A path of modules with puckbench and the installed package of the examples."""
    (package := tmp_path / "package").mkdir()
    write_files(package, PAGE)
    (package / "pyproject.toml").write_text(blocks(PAGE, "toml")[0])
    target = tmp_path / "installed"
    offline = ["--no-deps", "--no-index", "--no-build-isolation", "--disable-pip-version-check"]
    _program(tmp_path, "-m", "pip", "install", *offline, "--target", str(target), "./package")
    return f"{ROOT / 'src'}{os.pathsep}{target}"


def _check(results: Path) -> None:
    table = pd.read_csv(results / "tables" / "metrics.csv")
    assert len(table) == 2 * 2
    assert set(table.cloud) == {"box_1", "box_2"}
    # Four points of five are lost at r1, and none at r2; a number takes 16 bits.
    assert table[table.rate == "r2"].bpp.tolist() == [48.0, 48.0]
    scan = pd.read_parquet(results / "scans" / "boxes" / "box_1.parquet")
    assert table.centroid_m.between(0, 0.1).all()
    offset = scan["distance_noisy"] - scan["distance"]
    assert offset.to_numpy() == pytest.approx(0.01, abs=1e-6)
    drives = pd.read_csv(results / "tables" / "drives.csv")
    errors = drives.set_index("codec").nearest_error_m.groupby("codec").max()
    assert errors["undecoded"] == 0
    assert 0 < errors["puck"] <= 0.03  # a step and a half of 20 mm


def test_an_installed_package_brings_one_of_each_kind(fresh: Bench, installed: str) -> None:
    config = yaml.safe_load(blocks(PAGE, "yaml")[0])
    (fresh.folder / "config.yaml").write_text(yaml.safe_dump({**config, **RUN}))
    tables = (f"results/tables/{name}.csv" for name in ("metrics", "cheapest", "drives"))
    targets = (*tables, "results/figures/bits.png")  # what is made of the package alone
    _program(fresh.folder, *fresh.command(*targets)[1:], path=installed)
    _check(fresh.results)
    cheapest = pd.read_csv(fresh.results / "tables" / "cheapest.csv")
    assert cheapest.codec.tolist() == ["half_precision"]
    assert (fresh.results / "figures" / "bits.png").exists()


def test_the_same_files_serve_without_being_installed(fresh: Bench) -> None:
    write_files(fresh.folder, PAGE)
    config = yaml.safe_load(blocks(PAGE, "yaml")[0])
    config["scene_sets"]["boxes"]["loader"] = "example_data_set.py:Boxes"
    config["datasets"]["boxes"]["errors"] = "example_error_model.py:ConstantOffset"
    config["codecs"]["half_precision"]["class"] = "example_codec.py:HalfPrecision"
    config["metrics"] = ["example_metric.py:centroid"]
    config["drives"]["push"]["tasks"] = {"example_task.py:nearest": {}}
    config["tables"] = ["example_table.py:cheapest"]
    figures = {"own": ["example_figure.py:draw_bits"]}
    (fresh.folder / "config.yaml").write_text(yaml.safe_dump({**config, **RUN, "figures": figures}))
    fresh.made()
    _check(fresh.results)
    assert (fresh.results / "figures" / "draw_bits.pdf").exists()
    page = (fresh.results / "report.html").read_text(encoding="utf-8")
    assert 'id="figure-draw_bits"' in page
    assert 'id="table-cheapest"' in page
    inputs = '{"metrics": "results/tables/metrics.csv"}'
    puckbench = ["-m", "puckbench"]
    table = ["table", "example_table.py:cheapest", "cheapest.csv", "--inputs", inputs]
    _program(fresh.folder, *puckbench, *table)
    assert pd.read_csv(fresh.folder / "cheapest.csv").codec.tolist() == ["half_precision"]
    figure = ["figure", "example_figure.py:draw_bits", "bits.png", "--inputs", inputs]
    _program(fresh.folder, *puckbench, *figure)
    assert (fresh.folder / "bits.png").exists()

"""The wheels of the packages: whole, and at work where nothing else of this tree is."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import read_cloud, write_cloud
from pointkit.geometry.cloud import PointCloud
from tests.support.bench import ROOT

PACKAGES = sorted(path.parent.name for path in ROOT.glob("src/*/pyproject.toml"))
BUILT_FROM = ("src", "workflow", "envs")
NOT_IN_A_WHEEL = {"pyproject.toml", "LICENSE", "README.md"}  # the last two are beside the package
OFFLINE = ("--no-deps", "--no-index", "--disable-pip-version-check", "--quiet")


def done(*words: str | Path, cwd: Path) -> str:
    """What a program prints, run without this tree on its path."""
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    ended = subprocess.run(words, cwd=cwd, env=env, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr[-4000:]
    return ended.stdout


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The wheel of each package, built in a copy of the tree, which building would litter."""
    tree = tmp_path_factory.mktemp("tree")
    for name in BUILT_FROM:
        ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
        shutil.copytree(ROOT / name, tree / name, ignore=ignored, symlinks=True)
    shutil.copy(ROOT / "LICENSE", tree)
    sources = [f"./src/{name}" for name in PACKAGES]
    made = ["wheel", "--no-build-isolation", "--wheel-dir", "dist", *OFFLINE, *sources]
    done(sys.executable, "-m", "pip", *made, cwd=tree)
    return {path.name.partition("-")[0]: path for path in (tree / "dist").iterdir()}


def files_below(folder: Path) -> set[str]:
    """Relative paths of the files below a folder, without what running leaves there."""
    paths = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return {path.as_posix() for path in paths if "__pycache__" not in path.parts}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_wheel_has_every_file_of_its_package_and_the_licence(
    package: str, wheels: dict[str, Path]
) -> None:
    names = zipfile.ZipFile(wheels[package]).namelist()
    held = {name.removeprefix(f"{package}/") for name in names if name.startswith(f"{package}/")}
    expected = files_below(ROOT / "src" / package)
    if package == "puckbench":
        expected |= {f"workflow/{name}" for name in files_below(ROOT / "workflow")}
    assert held - NOT_IN_A_WHEEL == expected - NOT_IN_A_WHEEL
    assert any(name.endswith("/licenses/LICENSE") for name in names)


RUN = ("--codecs", "draco", "gpcc", "--rates", "r2", "r8", "--cores", "2")


def test_the_installed_wheels_code_with_their_own_weights_and_run_the_workflow(
    wheels: dict[str, Path], tmp_path: Path
) -> None:
    environment = tmp_path / "environment"
    done(sys.executable, "-m", "venv", "--without-pip", environment, cwd=tmp_path)
    python = environment / "bin" / "python"
    # What they need comes from this interpreter's packages; editable installs do not.
    where = "import sysconfig; print(sysconfig.get_path('purelib'))"
    packages = Path(done(python, "-c", where, cwd=tmp_path).strip())
    here = {sysconfig.get_path(name) for name in ("purelib", "platlib")}
    (packages / "needed.pth").write_text("\n".join(sorted(here)) + "\n")
    there = ("--ignore-installed", "--target", str(packages))
    done(sys.executable, "-m", "pip", "install", *OFFLINE, *there, *wheels.values(), cwd=tmp_path)
    for loops in (ROOT / "src").rglob("__pycache__/numba-*"):  # a digest of sources is in the name
        compiled = packages / loops.relative_to(ROOT / "src")
        compiled.parent.mkdir(exist_ok=True)
        compiled.symlink_to(loops)
    said = "import puckbench; print(puckbench.__file__)"
    assert done(python, "-c", said, cwd=tmp_path).startswith(str(packages))
    result = "from puckbench.planning.launch import snakefile; print(snakefile())"
    assert done(python, "-c", result, cwd=tmp_path).strip() == str(
        packages / "puckbench" / "workflow" / "Snakefile"
    )
    points = np.random.default_rng(0).integers(0, 64, (300, 3)).astype(np.float64)
    write_cloud(tmp_path / "a.ply", PointCloud(points, about={"size": 64}))
    puckbench = [python, "-m", "puckbench"]
    for codec in ("draco", "pcgcv2_plus"):
        rate = ["--codec", codec, "--rate", "r4", "--json"]
        record = json.loads(done(*puckbench, "encode", "a.ply", "a.bin", *rate, cwd=tmp_path))
        assert ("weights" in record) == (codec == "pcgcv2_plus")
        done(*puckbench, "decode", "a.bin", "b.ply", cwd=tmp_path)
        assert len(read_cloud(tmp_path / "b.ply")) > 0
    output = done(*puckbench, "run", "a.ply", *RUN, cwd=tmp_path).splitlines()
    assert [line.split()[:2] for line in output[1:3]] == [["Clouds", "Draco"], ["Clouds", "G-PCC"]]
    assert (tmp_path / "out" / "report.html").stat().st_size > 50_000
    for codec in ("draco", "gpcc"):
        curve = zipfile.ZipFile(tmp_path / "out" / "coded" / "clouds" / "a" / f"{codec}.zip")
        assert curve.namelist() == ["r2.bin", "r2.json", "r8.bin", "r8.json"]

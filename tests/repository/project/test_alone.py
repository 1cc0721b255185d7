"""A package of src/, installed alone in a new environment, has all that its README's examples need.

What a package needs besides comes from the index that pip is configured for. All but one of these
tests take minutes and gigabytes, and run only as `make alone`.
"""

import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.repository.project.test_readmes import python_blocks

ROOT = Path(__file__).parents[3]
NEEDED = {
    path.parent.name: tomllib.loads(path.read_text())["project"]["dependencies"]
    for path in sorted(ROOT.glob("src/*/pyproject.toml"))
}
NOT_FOUND = ("No matching distribution found", "Could not find a version", "Connection broken")


def ours(package: str) -> set[str]:
    """The packages of src/ that one needs, itself too."""
    direct = {line.partition("==")[0].partition("[")[0] for line in NEEDED[package]}
    return {package}.union(*map(ours, direct & NEEDED.keys()))


def done(*words: str | Path, cwd: Path) -> str:
    """What a program prints, run without this tree on its path."""
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    ended = subprocess.run(words, cwd=cwd, env=env, capture_output=True, text=True, check=False)
    if ended.returncode and "pip" in words and any(text in ended.stderr for text in NOT_FOUND):
        pytest.skip(ended.stderr.splitlines()[-1])
    assert ended.returncode == 0, ended.stderr[-4000:]
    return ended.stdout


def installed(package: str, folder: Path) -> tuple[Path, set[str]]:
    """The Python of a new environment with one package, and the names of all that is installed."""
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
    shutil.copytree(ROOT / "src", folder / "src", ignore=ignored)  # building litters it
    done(sys.executable, "-m", "venv", "--without-pip", "environment", cwd=folder)
    python = folder / "environment" / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", python)
    sources = [f"./src/{name}" for name in sorted(ours(package))]
    done(*pip, "install", "--quiet", "--no-compile", *sources, cwd=folder)
    found = json.loads(done(*pip, "list", "--format", "json", cwd=folder))
    shutil.rmtree(folder / "src")
    return python, {each["name"].lower() for each in found}


GPCC = """
import numpy as np
import gpcc

cloud = np.random.default_rng(0).random((1000, 3))
positions, origin = gpcc.quantise(cloud, scale=10_000)
stream = gpcc.encode_geometry(positions, gpcc.PROFILES["minimal"], scale=10_000, origin=origin)
decoded = gpcc.decode_geometry(stream).positions()
assert np.abs(np.sort(decoded, axis=0) - np.sort(cloud, axis=0)).max() < 0.0000501
"""


def test_gpcc_codes_without_open3d_snakemake_and_torch(tmp_path: Path) -> None:
    python, found = installed("gpcc", tmp_path)
    done(python, "-c", GPCC, cwd=tmp_path)
    assert len(found) < 20
    assert not found & {"open3d", "open3d-cpu", "snakemake", "torch", "pandas", "puckbench"}


@pytest.mark.alone
@pytest.mark.parametrize("package", NEEDED)
def test_the_examples_of_a_package_need_only_what_it_declares(package: str, tmp_path: Path) -> None:
    python, _found = installed(package, tmp_path)
    (tmp_path / "program.py").write_text(python_blocks(package))
    done(python, "program.py", cwd=tmp_path)
    if package == "puck":
        capture = ROOT / "tests" / "data" / "capture" / "dual.pcap"
        done(python, "-m", "puck", "compress", capture, "small.puck", cwd=tmp_path)
        done(python, "-m", "puck", "decompress", "small.puck", "again.pcap", cwd=tmp_path)
        assert (tmp_path / "again.pcap").read_bytes() == capture.read_bytes()
        assert (tmp_path / "small.puck").stat().st_size < capture.stat().st_size

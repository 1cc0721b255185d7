"""Imports run one way, as the contracts in pyproject.toml say, and planning loads nothing heavy."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import write_cloud
from pointkit.geometry.cloud import PointCloud

ROOT = Path(__file__).parents[3]


def _lines(*command: str | Path) -> list[str]:
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr
    return done.stdout.splitlines()


def test_the_contracts_between_rooms_hold() -> None:
    lines = _lines(Path(sys.executable).with_name("lint-imports"), "--no-cache")
    assert any(line.endswith("0 broken.") for line in lines)


HEAVY = {
    "torch",
    "constriction",
    "open3d",
    "numba",
    "matplotlib",
    "scipy",
    "pandas",
    "DracoPy",
    "trimesh",
    "pyarrow",
}
LIGHT = [
    "planning.workflow",
    "planning.running",
    "planning.plan",
    "planning.config",
    "cli",
    "codecs.registry",
    "scene_sets.registry",
]


@pytest.mark.parametrize("module", LIGHT)
def test_planning_imports_nothing_heavy(module: str) -> None:
    program = f"import sys, puckbench.{module}; print(*sys.modules)"
    loaded = _lines(sys.executable, "-c", program)[-1].split()
    assert HEAVY & set(loaded) == set()


REGISTRIES = [
    "puckbench.codecs.registry import CODECS",
    "puckbench.scene_sets.registry import LOADERS",
    "puckbench.figures.registry import FIGURES",
    "puckbench.steps.step import STEPS",
    "virtual_lidar.errors import ERROR_MODELS",
    "puckbench.metrics.metric_registry import METRICS",
    "puckbench.tables.registry import TABLES",
]


@pytest.mark.parametrize("registry", REGISTRIES)
def test_listing_plugins_imports_nothing_heavy(registry: str) -> None:
    name = registry.rpartition(" ")[2]
    program = f"import sys; from {registry}; assert {name}.names(); print(*sys.modules)"
    loaded = _lines(sys.executable, "-c", program)[-1].split()
    assert HEAVY & set(loaded) == set()


def test_help_imports_nothing_heavy() -> None:
    """Each command's own."""
    program = (
        "import sys; from puckbench.cli import parser_of;"
        "from puckbench.cli.registry import help_texts; parser_of(help_texts());"
        "print(*sys.modules)"
    )
    assert HEAVY & set(_lines(sys.executable, "-c", program)[-1].split()) == set()


NEEDED = {"draco": {"DracoPy"}, "gpcc": {"numba", "scipy"}}  # numba looks for scipy


@pytest.mark.parametrize("codec", NEEDED)
def test_a_classical_codecs_job_imports_no_other_codecs_packages(
    codec: str, tmp_path: Path
) -> None:
    write_cloud(tmp_path / "a.ply", PointCloud(np.random.default_rng(0).random((100, 3))))
    program = (
        "import sys; from puckbench.cli import main;"
        f"main(['encode', '{tmp_path}/a.ply', '{tmp_path}/a.bin', '--codec', '{codec}',"
        " '--rate', 'r1', '--json']); print(*sys.modules)"
    )
    loaded = _lines(sys.executable, "-c", program)[-1].split()  # the lines before are the answer
    assert (HEAVY - NEEDED[codec]) & set(loaded) == set()

"""Imports run one way: what makes artefacts knows nothing of figures, workflow and command line."""

import ast
from pathlib import Path

import pytest

from puckbench.planning.fingerprints import imports

SOURCE = Path(__file__).parents[2] / "src" / "puckbench"
LAYERS = [
    {"errors", "files", "seeding", "plugins", "codeversion", "compiling"},
    {"cloud", "mesh", "config"},
    {"meshfiles", "scenes", "render"},
    {"datasets", "sensor", "metrics"},
    {"prepare", "codecs"},
    {"analysis", "tables", "tablefiles", "figures", "plan", "jobtimes", "report"},
    {"workflow", "running", "cli", "__main__", "reproduce", "library"},
]
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}


def _package(module: str) -> str:
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else ""


@pytest.mark.parametrize("path", sorted(SOURCE.rglob("*.py")), ids=lambda path: path.stem)
def test_a_module_imports_only_its_own_layer_or_below(path: Path) -> None:
    own = path.relative_to(SOURCE).with_suffix("").parts[0]
    if own == "__init__":
        return
    for module in imports(ast.parse(path.read_text(encoding="utf-8"))):
        package = _package(module)
        if package in LEVEL:
            assert LEVEL[package] <= LEVEL[own], f"{own} imports {module}"


def test_every_package_has_a_layer() -> None:
    names = {path.stem for path in SOURCE.iterdir() if path.suffix == ".py" or path.is_dir()}
    assert names - {"__init__", "__pycache__", "py"} <= set(LEVEL)


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
LIGHT = ["workflow", "running", "plan", "config", "cli", "codecs.registry", "datasets.registry"]


@pytest.mark.parametrize("module", LIGHT)
def test_planning_imports_nothing_heavy(module: str) -> None:
    import subprocess
    import sys

    program = f"import sys, puckbench.{module}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert HEAVY & set(done.stdout.split()) == set()


NEEDED = {"draco": {"DracoPy"}, "gpcc": {"numba", "scipy"}}  # numba looks for scipy


@pytest.mark.parametrize("codec", NEEDED)
def test_a_classical_codecs_job_imports_no_other_codecs_packages(
    codec: str, tmp_path: Path
) -> None:
    import subprocess
    import sys

    import numpy as np

    from puckbench.geometry.cloud import PointCloud
    from puckbench.io.clouds import write_cloud

    write_cloud(tmp_path / "a.ply", PointCloud(np.random.default_rng(0).random((100, 3))))
    program = (
        "import sys; from puckbench.cli import main;"
        f"main(['encode', '{tmp_path}/a.ply', '{tmp_path}/a.bin', '--codec', '{codec}',"
        " '--rate', 'r1', '--json']); print(*sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    modules = done.stdout.splitlines()[-1].split()  # the lines before are the answer
    assert (HEAVY - NEEDED[codec]) & set(modules) == set()

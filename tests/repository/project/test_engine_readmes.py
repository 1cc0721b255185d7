"""The README of each package runs as it is, and its package offers what type checkers see."""

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[3] / "src"
READMES = [path for path in sorted(SOURCES.glob("*/README.md")) if "```python" in path.read_text()]
LAZY = [path.parent for path in SOURCES.glob("*/__init__.py") if "lazy(" in path.read_text()]
HEAVY = {"numba", "scipy", "torch", "open3d", "pandas", "matplotlib"}


def _name(path: Path) -> str:
    return path.name if path.is_dir() else path.parent.name


def _blocks(readme: Path) -> str:
    return "\n".join(re.findall(r"^```python\n(.*?)^```", readme.read_text(), re.S | re.M))


@pytest.mark.parametrize("readme", READMES, ids=_name)
def test_the_python_blocks_run_one_after_the_other(readme: Path, tmp_path: Path) -> None:
    program = tmp_path / "program.py"  # numba keeps compiled loops beside a file
    program.write_text(_blocks(readme))
    assert program.read_text()
    done = subprocess.run(
        [sys.executable, "-W", "error", program],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("package", LAZY, ids=_name)
def test_the_public_names_are_those_that_type_checkers_see(package: Path) -> None:
    tree = ast.parse((package / "__init__.py").read_text())
    (types,) = [node for node in tree.body if isinstance(node, ast.If)]
    seen = {
        alias.asname: (node.module, alias.name)
        for node in types.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    module = importlib.import_module(package.name)
    assert sorted(seen, key=str) == module.__all__
    for public, (source, name) in seen.items():
        assert source is not None
        assert public == name
        assert getattr(module, public) is getattr(importlib.import_module(source), name)


@pytest.mark.parametrize("package", LAZY, ids=_name)
def test_importing_a_package_imports_nothing_heavy(package: Path) -> None:
    program = f"import sys, {package.name}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert HEAVY & set(done.stdout.split()) == set()

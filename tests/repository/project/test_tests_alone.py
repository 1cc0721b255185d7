"""The tests of a package import only it, packages below it, and test support that does the same."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
OURS = {path.parent.name for path in (ROOT / "src").glob("*/__init__.py")}
ALLOWED = {"pointkit": {"pointkit"}, "puck": {"pointkit", "puck"}}
"""The packages that the tests of a package need."""


def _imported(file: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.update({node.module, *(f"{node.module}.{alias.name}" for alias in node.names)})
    return names


@pytest.mark.parametrize("package", ALLOWED)
def test_tests_of_a_package_need_no_other(package: str) -> None:
    files = [*(ROOT / "tests" / package).glob("*.py")]
    seen: set[Path] = set()
    outside: set[str] = set()
    while files:
        file = files.pop()
        seen.add(file)
        for name in _imported(file):
            top = name.partition(".")[0]
            if top in OURS - ALLOWED[package]:
                outside.add(f"{file.relative_to(ROOT)}: {name}")
            support = (ROOT / name.replace(".", "/")).with_suffix(".py")
            if top == "tests" and support.is_file() and support not in seen:
                files.append(support)
    assert outside == set()

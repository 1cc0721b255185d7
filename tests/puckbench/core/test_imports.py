"""What a file imports is followed within its package, beside it and within puckbench."""

from pathlib import Path

import pytest

from puckbench.core.imports import imported_files, reached_files

SOURCE = Path(__file__).parents[3] / "src" / "puckbench"


def written(path: Path, text: str = "") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "statement",
    [
        "from far import inner",
        "from far.inner import value",
        "import far.inner",
        "import far.inner as shorter",
        "from . import inner",
        "from .inner import (\n    value,\n)",
        "from ..far import inner",
        "def late():\n    from far import (  # why\n        inner,\n    )",
        "try:\n    import far.inner\nexcept ImportError:\n    pass",
    ],
)
def test_every_way_to_import_a_module_is_followed(tmp_path: Path, statement: str) -> None:
    written(tmp_path / "far" / "__init__.py")
    inner = written(tmp_path / "far" / "inner.py", "value = 1\n")
    user = written(tmp_path / "far" / "user.py", f"{statement}\n")
    if ".." in statement:
        written(tmp_path / "__init__.py")
    assert inner in imported_files(user)


def test_modules_beside_a_file_are_followed_to_what_they_import(tmp_path: Path) -> None:
    user = written(tmp_path / "user.py", "import numpy\nimport helper\n")
    helper = written(tmp_path / "helper.py", "from parts.first import one\n")
    first = written(
        tmp_path / "parts" / "first.py", "import helper\nfrom puckbench.core import files\n"
    )
    reached = reached_files(user)
    assert {user, helper, first, SOURCE / "core" / "files.py"} <= reached
    assert not any("site-packages" in str(path) for path in reached)


def test_of_an_installed_module_other_packages_are_not_followed(tmp_path: Path) -> None:
    folder = tmp_path / "site-packages"
    written(folder / "other.py")
    inner = written(folder / "mine" / "inner.py")
    written(folder / "mine" / "__init__.py")
    user = written(folder / "mine" / "user.py", "import other\nimport mine.inner\n")
    assert imported_files(user) == {inner}


def test_a_package_counts_where_a_name_that_it_defines_is_imported(tmp_path: Path) -> None:
    package = written(tmp_path / "far" / "__init__.py", "from far.inner import value\n")
    inner = written(tmp_path / "far" / "inner.py", "value = 1\n")
    assert reached_files(user := written(tmp_path / "a.py", "from far import value\n")) == {
        user, package, inner,
    }  # fmt: skip
    assert reached_files(user := written(tmp_path / "b.py", "import far.inner\n")) == {
        user, package, inner,
    }  # fmt: skip


def test_imports_for_type_checkers_are_not_followed(tmp_path: Path) -> None:
    written(tmp_path / "helper.py")
    user = written(tmp_path / "user.py", "if TYPE_CHECKING:\n    import helper\n")
    assert imported_files(user) == frozenset()


def test_files_that_are_left_out_are_not_followed(tmp_path: Path) -> None:
    user = written(tmp_path / "user.py", "import helper\n")
    helper = written(tmp_path / "helper.py", "import other\n")
    written(tmp_path / "other.py")
    assert reached_files(user, is_left_out=helper.__eq__) == {user}


def test_of_puckbench_the_imported_modules_are_followed() -> None:
    names = {str(path.relative_to(SOURCE)) for path in reached_files(SOURCE / "io/meshes/ply.py")}
    assert {"io/meshes/ply.py", "geometry/mesh.py", "core/errors.py"} <= names
    assert not any(name.startswith(("cli", "lidar")) for name in names)


LAZY = (
    "if TYPE_CHECKING:\n    from far.inner import value as value\n    from far.other import more\n"
)


@pytest.mark.parametrize(
    ("statement", "modules"),
    [
        ("from far import value", {"inner"}),
        ("from far import more", {"other"}),
        ("from far import inner", {"inner"}),
        ("from far import *", {"inner", "other"}),
        ("import far", {"inner", "other"}),
        ("from far import version", set()),
    ],
)
def test_of_a_lazy_package_the_modules_of_the_names_in_use_are_followed(
    tmp_path: Path, statement: str, modules: set[str]
) -> None:
    written(tmp_path / "far" / "__init__.py", LAZY)
    for name in ("inner", "other"):
        written(tmp_path / "far" / f"{name}.py")
    reached = imported_files(written(tmp_path / "user.py", f"{statement}\n"))
    assert {path.stem for path in reached} - {"__init__"} == modules


@pytest.mark.parametrize("statement", ["import gpcc", "from puckbench import gpcc"])
def test_code_that_imports_an_engine_reaches_all_of_it(tmp_path: Path, statement: str) -> None:
    reached = reached_files(written(tmp_path / "user.py", f"{statement}\n"))
    names = {str(path.relative_to(SOURCE)) for path in reached if path.is_relative_to(SOURCE)}
    assert {"gpcc/octree.py", "gpcc/arithmetic.py", "gpcc/attributes/raht.py"} <= names

"""Plug-ins of a user's own file beside ours."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import FunctionType

import pytest

from pointkit.errors import InputError
from pointkit.registry import Registry, load, trust
from puckbench.tables.registry import TABLES


def test_an_added_plugin_is_listed_and_found_by_its_name(tmp_path: Path) -> None:
    registry: Registry[int] = Registry("number", "numbers")
    (tmp_path / "numbers.py").write_text("seven = 7\n")
    place = f"{tmp_path / 'numbers.py'}:seven"
    trust([place])
    registry.add(place)
    registry.add(place)
    assert registry.names() == ["seven"]
    assert registry.get("seven") == 7
    assert registry.place_of("seven") == place
    assert registry.module_of("seven") == str(tmp_path / "numbers.py")
    with pytest.raises(InputError, match=r"other.py:seven: that name is taken"):
        registry.add("other.py:seven")
    with pytest.raises(InputError, match=r"must be module:Name or file.py:Name"):
        registry.add("seven")


def test_a_place_that_no_user_named_is_not_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "unnamed_numbers.py").write_text("from pathlib import Path\nPath('ran').touch()\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    registry: Registry[int] = Registry("number", "numbers")
    trust(["unnamed_numbers", None, ""])
    for place in ("unnamed_numbers.py:eight", "unnamed_numbers:eight"):
        for use in (
            registry.get,
            registry.add,
            registry.module_of,
            lambda one: load(one, "number"),
        ):
            with pytest.raises(InputError, match=rf"^number.*'{place}' is code that is not load"):
                use(place)
    assert not Path("ran").exists()


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("import sys; sys.exit()", r"SystemExit: exit status 0 \(faulty.py:1\)"),
        ("unknown", r"NameError: name 'unknown' is not defined \(faulty.py:1\)"),
        ("import no_such_module", "No module named 'no_such_module'"),
    ],
)
def test_a_file_that_fails_when_imported_is_told_in_a_line(
    line: str, why: str, tmp_path: Path
) -> None:
    file = tmp_path / "faulty.py"
    file.write_text(f"{line}\nseven = 7\n")
    trust([f"{file}:seven"])
    with pytest.raises(InputError, match=rf"^number: cannot load '{file}:seven' \({why}\)$"):
        load(f"{file}:seven", "number")


def test_a_file_that_changes_the_folder_when_imported_changes_it_for_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "moving.py").write_text("import os\nos.chdir('/')\nseven = 7\n")
    monkeypatch.chdir(tmp_path)
    trust(["moving.py:seven"])
    assert load("moving.py:seven", "number") == 7
    assert Path.cwd() == tmp_path


def _function_of(module: str) -> Callable[[], int]:
    return FunctionType((lambda: 7).__code__, {"__name__": module})


def test_a_name_of_puckbench_belongs_to_one_module() -> None:
    registry: Registry[Callable[[], int]] = Registry("number", "numbers")
    register = registry.register("seven")
    for module in ("mine", "yours", "puckbench.numbers.seven", "puckbench.numbers.seven"):
        register(_function_of(module))
    for module in ("puckbench.numbers.another", "mine"):
        fault = rf"^number seven: {module} registers the name of puckbench.numbers.seven: rename it"
        with pytest.raises(InputError, match=fault):
            register(_function_of(module))


def test_the_modules_of_every_folder_of_a_kind_are_found() -> None:
    modules = {TABLES.module_of(name).rpartition(".")[0] for name in TABLES.names()}
    assert modules >= {"puckbench.tables", "jenco2022.tables"}
    assert all(each.endswith(".tables") for each in modules)


def _load(place: str) -> object:
    return load(place, "number")

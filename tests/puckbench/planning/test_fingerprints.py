"""Fingerprints change with the code that makes an artefact, and with nothing else."""

import shutil
from pathlib import Path

import pytest

from puckbench.core import imports
from puckbench.planning import fingerprints
from puckbench.planning.fingerprints import covered

SOURCE = Path(__file__).parents[3] / "src" / "puckbench"


def code_version(*modules: str | Path) -> str:
    """As a new process sees it, for files that have been edited."""
    for remembered in (fingerprints.code_version, fingerprints._code_digest):
        remembered.cache_clear()
    for result in (imports.imported_files, imports.module_file, imports.top_folder):
        result.cache_clear()
    return fingerprints.code_version(*map(str, modules))


def _version(path: Path, text: str) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return code_version(path)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of puckbench's sources, to be edited."""
    skipped = shutil.ignore_patterns("__pycache__", "weights", "assets", "*.json")
    return shutil.copytree(SOURCE, tmp_path / "puckbench", ignore=skipped)


ARTEFACTS = {
    "draco": ("core/measurement.py", "codecs/draco.py"),
    "gpcc": ("core/measurement.py", "codecs/gpcc.py"),
    "scan": ("lidar/scan.py", "lidar/errors/vlp16.py"),
    "table": ("io/tables.py", "thesis/tables/printed_tables.py"),
    "figure": ("figures/drawing.py", "figures/curves.py"),
}
"""Some artefacts with the modules of their job and of their plug-in."""


def _changed(tree: Path, edited: str, old: str, new: str) -> set[str]:
    """The artefacts whose fingerprints an edit of one file changes."""

    def versions() -> dict[str, str]:
        return {
            name: code_version(*(tree / file for file in files))
            for name, files in ARTEFACTS.items()
        }

    before, path = versions(), tree / edited
    text = path.read_text() if path.exists() else ""
    assert old in text
    path.write_text(text.replace(old, new, 1) if old else text + new)
    return {name for name, version in versions().items() if version != before[name]}


def test_a_help_text_of_the_command_line_re_makes_nothing(tree: Path) -> None:
    shown = "code a cloud with a codec at a rate"
    assert _changed(tree, "cli/registry.py", shown, "make a cloud smaller") == set()


def test_the_command_line_re_makes_nothing_even_where_it_is_imported(tree: Path) -> None:
    (tree / "codecs" / "draco.py").write_text("from puckbench.cli.types import shape\n")
    assert _changed(tree, "cli/types.py", "", "\nLIMIT = 3\n") == set()


def test_a_new_plugin_re_makes_nothing(tree: Path) -> None:
    entry = (
        "from jenco2022.tables import TABLES\n\n\n"
        '@TABLES.register("mine")\ndef mine(metrics):\n    return metrics\n'
    )
    assert _changed(tree, "thesis/a_new_table.py", "", entry) == set()


@pytest.mark.parametrize("room", ["codecs", "datasets", "figures"])
def test_an_edited_registry_re_makes_nothing(tree: Path, room: str) -> None:
    assert _changed(tree, f"{room}/registry.py", "", "\nMORE = 1\n") == set()


def test_an_edited_codec_re_makes_its_own_streams_alone(tree: Path) -> None:
    assert _changed(tree, "codecs/draco.py", "", "\nLIMIT = 3\n") == {"draco"}
    assert _changed(tree, "gpcc/octree.py", "", "\nLIMIT = 3\n") == {"gpcc"}


def test_an_edited_contract_re_makes_the_streams_of_all_codecs(tree: Path) -> None:
    """And what figures take from it, titles and colours, re-makes them; but no scan or table."""
    assert _changed(tree, "codecs/base.py", "", "\nLIMIT = 3\n") == {"draco", "gpcc"}
    changed = _changed(tree, "codecs/facts.py", "", "\nLIMIT = 3\n")
    assert changed == {"draco", "gpcc", "figure"}


def test_an_edited_error_model_re_makes_its_scans_alone(tree: Path) -> None:
    assert _changed(tree, "lidar/errors/vlp16.py", "", "\nLIMIT = 3\n") == {"scan"}


def test_a_packages_docstring_re_makes_nothing(tree: Path) -> None:
    assert _changed(tree, "gpcc/__init__.py", '"""', '"""More about ') == set()
    assert _changed(tree, "scenes/__init__.py", '"""', '"""More about ') == set()


def test_comments_and_docstrings_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    plain = _version(path, "def f():\n    return 1\n")
    assert _version(path, "# why\n\n\ndef f():\n    return 1  # because\n") == plain
    with_text = _version(path, 'def f():\n    """Say."""\n    return 1\n')
    assert _version(path, 'def f():\n    """Say more."""\n    return 1\n') == with_text
    assert with_text == plain


def test_the_help_text_of_an_option_does_not_count(tree: Path, tmp_path: Path) -> None:
    shown = 'description="'
    assert shown in (tree / "codecs/draco.py").read_text()
    assert _changed(tree, "codecs/draco.py", shown, f"{shown}In other words: ") == set()
    path, field = tmp_path / "a.py", 'size: int = Field(gt={}, description="{}")\n'
    assert _version(path, field.format(0, "a")) == _version(path, field.format(0, "b"))
    assert _version(path, field.format(0, "a")) != _version(path, field.format(1, "a"))


def test_imports_for_type_checkers_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    plain = _version(path, "x = 1\n")
    checked = "if TYPE_CHECKING:\n    from pointkit.files import whole\nx = 1\n"
    assert _version(path, checked) == plain


def test_what_runs_in_place_of_imports_for_type_checkers_counts(tmp_path: Path) -> None:
    path, text = tmp_path / "a.py", "if TYPE_CHECKING:\n    pass\nelse:\n    x = {}\n"
    assert _version(path, text.format(1)) != _version(path, text.format(2))


def test_code_counts(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    assert _version(path, "x = 1\n") != _version(path, "x = 2\n")


def test_numbers_beside_a_module_count(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    alone = _version(path, "x = 1\n")
    path.with_suffix(".yaml").write_text("b: 1\n")
    assert _version(path, "x = 1\n") != alone


def test_a_module_of_another_package_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def version(text: str) -> str:
        (tmp_path / "a_package" / "mine.py").write_text(text)
        return code_version("a_package.mine")

    (tmp_path / "a_package").mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    assert version("x = 1\n") != version("x = 2\n")


def _version_with(codec: Path, edited: Path, text: str) -> str:
    """The fingerprint of a codec after an edit of another file."""
    _version(edited, text)
    return code_version(codec)


def test_what_a_users_codec_imports_beside_its_file_counts(tmp_path: Path) -> None:
    codec, helper = tmp_path / "mine.py", tmp_path / "helper.py"
    _version(codec, "def encode():\n    from helper import step\n    return step\n")
    before = _version_with(codec, helper, "step = 1\n")
    edited = _version_with(codec, helper, "import parts.first\nstep = 1\n")
    assert edited != before
    assert _version_with(codec, tmp_path / "unused.py", "x = 1\n") == edited
    assert _version_with(codec, tmp_path / "parts" / "first.py", "x = 1\n") != edited


@pytest.mark.parametrize("statement", ["from . import helper", "from mine.helper import step"])
def test_what_a_users_codec_imports_of_its_package_counts(tmp_path: Path, statement: str) -> None:
    codec, helper = tmp_path / "mine" / "codec.py", tmp_path / "mine" / "helper.py"
    _version(tmp_path / "mine" / "__init__.py", "")
    _version(codec, f"{statement}\n")
    before = _version_with(codec, helper, "step = 1\n")
    assert _version_with(codec, helper, "step = 2\n") != before


def test_one_folder_of_the_same_code_is_as_good_as_another(tmp_path: Path) -> None:
    def version(folder: Path) -> str:
        _version(folder / "helper.py", "step = 1\n")
        return _version(folder / "mine.py", "import helper\n")

    assert version(tmp_path / "a") == version(tmp_path / "b")


def test_one_codec_does_not_depend_on_another() -> None:
    def names(artefact: str) -> set[str]:
        files = covered(*(str(SOURCE / file) for file in ARTEFACTS[artefact]))
        return {file.relative_to(SOURCE).as_posix() for file in files}

    assert {"codecs/draco.py", "codecs/base.py"} <= names("draco")
    assert "codecs/draco.py" not in names("gpcc")
    assert not any(name.startswith("figures") for name in names("draco"))


def test_a_module_is_that_of_the_sources_in_use() -> None:
    assert code_version("puckbench.codecs.draco") == code_version(SOURCE / "codecs/draco.py")

"""Fingerprints change with the code that makes an artefact, and with nothing else."""

from pathlib import Path

import pytest

from pointkit.registry import load, trust
from puckbench.steps import fingerprints, user_code
from puckbench.steps.fingerprints import covered
from puckbench.steps.user_code import imported_files


def code_version(*names: str | Path) -> str:
    """As a new process sees it, for files that have been edited."""
    remembered_by = (fingerprints.code_version, covered, fingerprints._code_digest, imported_files)
    for remembered in (*remembered_by, user_code._read):
        remembered.cache_clear()
    return fingerprints.code_version(*map(str, names))


def _version(path: Path, text: str) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return code_version(path)


def test_comments_and_docstrings_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    plain = _version(path, "def f():\n    return 1\n")
    assert _version(path, "# why\n\n\ndef f():\n    return 1  # because\n") == plain
    with_text = _version(path, 'def f():\n    """Say."""\n    return 1\n')
    assert _version(path, 'def f():\n    """Say more."""\n    return 1\n') == with_text
    assert with_text == plain


def test_the_help_text_of_an_option_does_not_count(tmp_path: Path) -> None:
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


def test_what_a_users_codec_imports_from_elsewhere_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    codec, library = tmp_path / "mine" / "codec.py", tmp_path / "lib" / "far_library.py"
    _version(library, "def step():\n    return 1\n")
    monkeypatch.syspath_prepend(library.parent)
    _version(codec, "from far_library import step\nclass Mine:\n    step = step\n")
    trust([place := f"{codec}:Mine"])
    load(place, "codec")
    before = code_version(codec)
    assert library in covered(str(codec))
    assert _version_with(codec, library, "def step():\n    return 2\n") != before


def test_a_codec_beside_another_counts_only_where_it_is_mentioned(tmp_path: Path) -> None:
    codec, other = tmp_path / "mine.py", tmp_path / "yours.py"
    _version(codec, "step = 1\n")
    _version(other, "class Yours: ...\n")
    trust([f"{codec}:Mine", f"{other}:Yours"])
    before = code_version(codec)
    assert _version_with(codec, other, "class Yours:\n    step = 2\n") == before
    mentions = _version(codec, "def encode():\n    from yours import Yours\n")
    assert _version_with(codec, other, "class Yours: ...\n") != mentions


def test_what_a_plugin_names_is_its_code() -> None:
    def names(*modules: str) -> set[str]:
        return {f"{file.parent.name}/{file.name}" for file in covered(*modules)}

    draco = names("puckbench.steps.encode", "puckbench.codecs.draco")
    assert {"codecs/draco.py", "codecs/base.py", "cloud_files/ply.py"} <= draco
    assert not draco & {"gpcc/octree.py", "figures/style.py", "cloud_files/las.py"}
    predictive = names("puckbench.codecs.gpcc_predictive")
    assert {"codecs/gpcc.py", "gpcc/octree.py", "attributes/raht.py"} <= predictive
    assert "codecs/draco.py" not in predictive


def test_a_room_counts_without_its_plugins() -> None:
    figures = {file.name for file in covered("puckbench.figures")}
    assert "style.py" in figures
    assert "spread.py" not in figures
    models = {file.name for file in covered("virtual_lidar.errors")}
    assert "receiver.py" in models
    assert "vlp16.py" not in models


def test_a_misspelt_name_is_an_error() -> None:
    with pytest.raises((ImportError, FileNotFoundError)):
        code_version("puckbench.codecs.drago")

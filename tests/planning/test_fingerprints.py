"""Fingerprints change with the code that makes an artefact, and with nothing else."""

import ast
import shutil
from pathlib import Path

import pytest

from puckbench.planning.fingerprints import Import, Sources, code_version, imports

SOURCE = Path(__file__).parents[2] / "src" / "puckbench"


def _version(path: Path, text: str) -> str:
    path.write_text(text)
    return Sources(SOURCE).code_version(str(path))


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of puckbench's sources, to be edited."""
    skipped = shutil.ignore_patterns("__pycache__", "weights", "assets", "*.json")
    return shutil.copytree(SOURCE, tmp_path / "puckbench", ignore=skipped)


ARTEFACTS = {
    "draco": ("puckbench.codecs.measurement", "puckbench.codecs.draco"),
    "gpcc": ("puckbench.codecs.measurement", "puckbench.codecs.gpcc.codec"),
    "scan": ("puckbench.lidar.scan", "puckbench.lidar.errors.vlp16"),
    "table": ("puckbench.io.tables", "puckbench.thesis.printed_tables"),
    "figure": ("puckbench.figures.drawing", "puckbench.figures.curves"),
}
"""Some artefacts with the modules of their job and of their plug-in."""


def _changed(tree: Path, edited: Path | str, old: str, new: str) -> set[str]:
    """The artefacts whose fingerprints an edit of one file changes."""
    before = {name: Sources(tree).code_version(*needs) for name, needs in ARTEFACTS.items()}
    path = tree / edited
    text = path.read_text() if path.exists() else ""
    assert old in text
    path.write_text(text.replace(old, new, 1) if old else text + new)
    after = {name: Sources(tree).code_version(*needs) for name, needs in ARTEFACTS.items()}
    return {name for name, version in after.items() if version != before[name]}


def test_a_help_text_of_the_command_line_re_makes_nothing(tree: Path) -> None:
    shown = "code a cloud with a codec at a rate"
    assert _changed(tree, "cli/__init__.py", shown, "make a cloud smaller") == set()


def test_the_command_line_re_makes_nothing_even_where_it_is_imported(tree: Path) -> None:
    (tree / "codecs" / "draco.py").write_text("from puckbench.cli.types import shape\n")
    assert _changed(tree, "cli/types.py", "", "\nLIMIT = 3\n") == set()


def test_a_new_plugin_re_makes_nothing(tree: Path) -> None:
    entry = (
        "from puckbench.thesis.tables import TABLES\n\n\n"
        '@TABLES.register("mine")\ndef mine(metrics):\n    return metrics\n'
    )
    assert _changed(tree, "thesis/a_new_table.py", "", entry) == set()


@pytest.mark.parametrize("room", ["codecs", "datasets", "figures"])
def test_an_edited_registry_re_makes_nothing(tree: Path, room: str) -> None:
    assert _changed(tree, f"{room}/registry.py", "", "\nMORE = 1\n") == set()


def test_an_edited_codec_re_makes_its_own_streams_alone(tree: Path) -> None:
    assert _changed(tree, "codecs/draco.py", "", "\nLIMIT = 3\n") == {"draco"}
    assert _changed(tree, "codecs/gpcc/octree.py", "", "\nLIMIT = 3\n") == {"gpcc"}


def test_an_edited_contract_re_makes_the_streams_of_all_codecs(tree: Path) -> None:
    """And of figures, which take titles and colours from it; but no scan and no table."""
    changed = _changed(tree, "codecs/base.py", "", "\nLIMIT = 3\n")
    assert changed == {"draco", "gpcc", "figure"}


def test_an_edited_error_model_re_makes_its_scans_alone(tree: Path) -> None:
    assert _changed(tree, "lidar/errors/vlp16.py", "", "\nLIMIT = 3\n") == {"scan"}


def test_a_packages_docstring_re_makes_nothing(tree: Path) -> None:
    assert _changed(tree, "codecs/gpcc/__init__.py", '"""', '"""More about ') == set()
    assert _changed(tree, "geometry/__init__.py", '"""', '"""More about ') == set()


def _module(tree: Path, name: str, text: str) -> None:
    path = tree / f"{name}.py"
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)


def test_a_packages_re_exports_lead_to_the_modules_that_define_the_names(tree: Path) -> None:
    _module(tree, "room/near", "def near():\n    return 1\n")
    _module(tree, "room/far", "def far():\n    return 2\n")
    _module(
        tree,
        "room/__init__",
        "from puckbench.room.far import far\nfrom puckbench.room.near import near\n",
    )
    _module(tree, "user", "from puckbench.room import near\n")
    assert Sources(tree).covered("puckbench.user") == {"puckbench.user", "puckbench.room.near"}


def test_what_a_package_defines_itself_counts_with_what_it_uses(tree: Path) -> None:
    _module(tree, "room/near", "def near():\n    return 1\n")
    _module(tree, "room/far", "def far():\n    return 2\n")
    _module(
        tree,
        "room/__init__",
        "from puckbench.room.far import far\nfrom puckbench.room.near import near\n\n\n"
        "def nearer():\n    return near()\n",
    )
    _module(tree, "user", "from puckbench.room import nearer\n")
    expected = {"puckbench.user", "puckbench.room", "puckbench.room.near"}
    assert Sources(tree).covered("puckbench.user") == expected


def test_comments_docstrings_and_registries_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    plain = _version(path, "def f():\n    return 1\n")
    assert _version(path, "# why\n\n\ndef f():\n    return 1  # because\n") == plain
    with_text = _version(path, 'def f():\n    """Say."""\n    return 1\n')
    assert _version(path, 'def f():\n    """Say more."""\n    return 1\n') == with_text
    assert with_text == plain
    registry = 'CODECS: Registry[Codec] = Registry("codec", "codecs")\n\n\n'
    assert _version(path, f"{registry}def f():\n    return 1\n") == plain


def test_registrations_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    function = "def f():\n    return 1\n"
    plain = _version(path, function)
    assert _version(path, f'@TABLES.register("a", category="All")\n{function}') == plain
    assert _version(path, f"@cache\n{function}") != plain


def test_the_presentation_of_a_plugin_does_not_count(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    registered = '@CODECS.register("a")\nclass A:\n    points = 1\n'
    plain = _version(path, registered)
    assert _version(path, f'{registered}    title = "An A"\n    rank: int = 3\n') == plain
    assert _version(path, f"{registered}    limit = 3\n") != plain


def test_fields_of_other_classes_count_whatever_they_are_called(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    assert _version(path, 'class A:\n    title = "a"\n') != _version(path, "class A:\n    pass\n")


def test_help_texts_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    field = 'size: int = Field(gt=0, description="{}")\n'
    assert _version(path, field.format("how many")) == _version(path, field.format("number"))
    option = 'parser.add_argument("--size", type={}, help="{}")\n'
    plain = _version(path, option.format("int", "how many"))
    assert _version(path, option.format("int", "number")) == plain
    assert _version(path, option.format("str", "number")) != plain


def test_imports_for_type_checkers_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    plain = _version(path, "x = 1\n")
    checked = "if TYPE_CHECKING:\n    from puckbench.core.files import whole\nx = 1\n"
    assert _version(path, checked) == plain


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
        return Sources(SOURCE).code_version("a_package.mine")

    (tmp_path / "a_package").mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    assert version("x = 1\n") != version("x = 2\n")


def test_imports_are_followed_at_every_depth(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    alone = _version(path, "def f():\n    import os\n    return os\n")
    with_ours = _version(path, "def f():\n    import puckbench.core.files\n    return 1\n")
    assert alone != with_ours
    tree = ast.parse("import os\ndef f():\n    from puckbench.codecs import draco\n")
    assert list(imports(tree)) == [("draco", Import("puckbench.codecs", "draco"))]


def test_one_codec_does_not_depend_on_another() -> None:
    seen = Sources(SOURCE).covered(*ARTEFACTS["draco"])
    assert "puckbench.codecs.draco" in seen
    assert "puckbench.codecs.base" in seen
    assert "puckbench.codecs.draco" not in Sources(SOURCE).covered(*ARTEFACTS["gpcc"])
    assert not any(name.startswith("puckbench.figures") for name in seen)


def test_a_version_is_that_of_the_sources_in_use() -> None:
    assert code_version("puckbench.codecs.draco") == Sources(SOURCE).code_version(
        "puckbench.codecs.draco"
    )

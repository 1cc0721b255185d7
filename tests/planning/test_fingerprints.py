import ast
from pathlib import Path

import pytest

from puckbench.planning.fingerprints import code_version, imports


def _version(path: Path, text: str) -> str:
    path.write_text(text)
    code_version.cache_clear()
    from puckbench.planning import fingerprints as codeversion

    codeversion._read.cache_clear()
    return code_version(str(path))


def test_comments_docstrings_and_registries_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    plain = _version(path, "def f():\n    return 1\n")
    assert _version(path, "# why\n\n\ndef f():\n    return 1  # because\n") == plain
    with_text = _version(path, 'def f():\n    """Say."""\n    return 1\n')
    assert _version(path, 'def f():\n    """Say more."""\n    return 1\n') == with_text
    assert _version(path, 'REGISTRY = {"a": 1}\n\n\ndef f():\n    return 1\n') == plain


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
    from puckbench.planning import fingerprints as codeversion

    def version(text: str) -> str:
        (tmp_path / "a_package" / "mine.py").write_text(text)
        for cached in (code_version, codeversion._read, codeversion._source):
            cached.cache_clear()
        return code_version("a_package.mine")

    (tmp_path / "a_package").mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    assert version("x = 1\n") != version("x = 2\n")


def test_imports_are_followed_at_every_depth(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    alone = _version(path, "def f():\n    import os\n    return os\n")
    with_ours = _version(path, "def f():\n    import puckbench.core.files\n    return 1\n")
    assert alone != with_ours
    tree = ast.parse("import os\ndef f():\n    from puckbench.codecs import draco\n")
    assert list(imports(tree)) == ["puckbench.codecs", "puckbench.codecs.draco"]


def test_one_codec_does_not_depend_on_another() -> None:
    seen = _modules("puckbench.cli.encode", "puckbench.codecs.draco")
    assert "puckbench.codecs.draco" in seen
    assert "puckbench.codecs.base" in seen
    assert "puckbench.codecs.draco" not in _modules("puckbench.cli.encode")
    assert not any(name.startswith("puckbench.figures") for name in seen)


def _modules(*names: str) -> set[str]:
    from puckbench.planning import fingerprints as codeversion

    found: dict[str, str] = {}
    for name in names:
        codeversion._collect(name, found)
    return set(found)

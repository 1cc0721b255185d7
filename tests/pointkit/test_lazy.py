import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

INIT = """
from pointkit.lazy import lazy

__getattr__, __dir__, __all__ = lazy(__name__, coder=("encode", "decode"), options=("Options",))
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    folder = tmp_path / "lazy_package"
    folder.mkdir()
    (folder / "__init__.py").write_text(INIT)
    (folder / "coder.py").write_text("def encode(): ...\ndef decode(): ...\n")
    (folder / "options.py").write_text("class Options: ...\n")
    monkeypatch.syspath_prepend(tmp_path)
    import lazy_package

    yield lazy_package
    for name in [name for name in sys.modules if name.startswith("lazy_package")]:
        del sys.modules[name]


def test_a_module_is_imported_when_a_name_of_it_is_used(package: ModuleType) -> None:
    assert "lazy_package.coder" not in sys.modules
    encode = package.encode
    assert encode is sys.modules["lazy_package.coder"].encode
    assert "lazy_package.options" not in sys.modules


def test_names_are_listed_without_importing_them(package: ModuleType) -> None:
    assert package.__all__ == ["Options", "decode", "encode"]
    assert dir(package) == package.__all__
    assert "lazy_package.coder" not in sys.modules


def test_a_star_import_brings_every_name(package: ModuleType) -> None:
    names: dict[str, object] = {}
    exec("from lazy_package import *", names)  # noqa: S102
    assert {"Options", "decode", "encode"} <= set(names)


def test_other_names_are_missing_as_in_any_module(package: ModuleType) -> None:
    with pytest.raises(AttributeError, match=r"module 'lazy_package' has no attribute 'other'"):
        _ = package.other

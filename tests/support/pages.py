"""The code that pages of the documentation show."""

from __future__ import annotations

import importlib.util
import re
import shlex
from itertools import takewhile
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[2]


def extension(name: str) -> ModuleType:
    """Import a module of the documentation's site, by its name in ``docs/extensions``."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs/extensions" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def page(name: str) -> str:
    """The text of a page, named from the root of the repository."""
    return (ROOT / name).read_text(encoding="utf-8")


def blocks(name: str, language: str) -> list[str]:
    """A page's code in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", page(name), re.DOTALL | re.MULTILINE)


def commands(name: str) -> list[list[str]]:
    """The words of each shell command on a page, without comments and where its output goes."""
    lines = "".join(blocks(name, "sh")).replace("\\\n", " ").splitlines()
    split = (shlex.split(line, comments=True) for line in lines)
    return [[*takewhile(lambda word: word != ">", words)] for words in split if words]


def write_files(folder: Path, *names: str) -> None:
    """Write the pages' Python files where their first lines say; other code is left out."""
    for name in names:
        for block in blocks(name, "python"):
            if result := re.match(r'"""([\w/]+\.py): ', block):
                path = folder / result[1]
                path.parent.mkdir(exist_ok=True)
                path.write_text(block)

"""The page on the architecture follows one room through the code: its files and functions exist."""

from __future__ import annotations

import re
from importlib import import_module
from operator import attrgetter
from pathlib import Path

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "explanation" / "architecture.md"
ROW = re.compile(r"^\| `(\w+/\w+)\.py` \| `([\w.]+)` \| (.+) \|$", re.M)


def test_the_walk_through_the_code_is_short_and_its_functions_exist() -> None:
    _, _, after = PAGE.read_text(encoding="utf-8").partition("## One room,")
    rows = ROW.findall(after.partition("\n## ")[0])
    assert 8 <= len(rows) <= 12
    for file, function, what in rows:
        assert callable(attrgetter(function)(import_module(f"puckbench.{file.replace('/', '.')}")))
        for other in re.findall(r"`(\w+/\w+\.py)`", what):
            assert (ROOT / "src" / "puckbench" / other).is_file()


def test_each_rule_has_a_step_of_its_name() -> None:
    from puckbench.steps.step import STEPS

    texts = [path.read_text() for path in (ROOT / "workflow" / "rules").glob("*.smk")]
    rules = {name for text in texts for name in re.findall(r"^\s*rule (\w+):$", text, re.M)}
    called = {name for text in texts for name in re.findall(r"puckbench\.steps (\w+) ", text)}
    assert rules == called
    assert {STEPS.module_of(name).rpartition(".")[2] for name in rules} == rules

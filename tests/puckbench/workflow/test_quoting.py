"""Rules quote the files of their commands: a folder of results may have spaces in its name."""

import re
from pathlib import Path

import pytest

from puckbench.planning.config import checked
from tests.support.bench import ROOT

RULES = sorted((ROOT / "workflow" / "rules").glob("*.smk"))


@pytest.mark.parametrize("rules", RULES, ids=lambda path: path.stem)
def test_files_of_commands_are_quoted(rules: Path) -> None:
    lines = [line for line in rules.read_text().splitlines() if re.match(r'\s+"', line)]
    commands = [line for line in lines if "puckbench.steps" in line or "{log" in line]
    assert not [line for line in commands if re.search(r"\{(input|output|log)[.\w]*\}", line)], (
        rules
    )


@pytest.mark.parametrize("folder", ["my results", "Ergebnisse für München", "a/b-1.0"])
def test_a_folder_of_results_may_have_any_letters(folder: str) -> None:
    config = {
        "scene_sets": {"rooms": {"loader": "embedded_rooms"}},
        "datasets": {"d": {"scene_set": "rooms", "make": "sample", "points": 10}},
        "results": folder,
    }
    assert checked(config).results == folder

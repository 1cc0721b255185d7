"""The checklist of the thesis's figures and tables."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml
from snakemake.cli import parse_args

from puckbench.cli import main
from puckbench.thesis.checklist import Item, Reproduction

CONFIG: dict[str, Any] = {
    "scenes": {
        "objects": {
            "loader": "capod",
            "options": {"path": "data/CAPOD"},
            "stand_in": {"loader": "embedded_objects", "limit": 2},
        }
    },
    "datasets": {"capod": {"scenes": "objects", "make": "sample", "points": 1000}},
    "codecs": {"draco": {"rates": ["r1", "r8"]}},
    "sensor_study": {"runs": 1},
    "figures": {"stand_in": {"examples": {"object": "capod/airplane_01"}}},
}


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Reproduction:
    """A small configuration whose data are not there, with stand-ins."""
    monkeypatch.chdir(tmp_path)
    Path("c.yaml").write_text(yaml.safe_dump(CONFIG))
    return Reproduction(Path("c.yaml"), {"stand_in": True})


def states(asked: Reproduction) -> dict[str, Item]:
    return {item.name: item for item in asked.items()}


def test_every_figure_and_table_of_the_thesis_is_listed(asked: Reproduction) -> None:
    result = [item.title for item in asked.items()]
    assert result == [
        *(f"Table {number}" for number in ("4.1", "4.2", "5.1")),
        *(f"Figure 5.{number}" for number in range(1, 22)),
        *(f"Figure 6.{number}" for number in range(1, 10)),
    ]


def test_what_is_missing_has_the_command_that_makes_it(asked: Reproduction) -> None:
    item = states(asked)["fig_6_5"]
    assert item.state == "missing"
    program, *words = shlex.split(item.note)
    _, read = parse_args(words)  # as Snakemake itself reads them
    assert (program, read.cores, read.configfile) == ("snakemake", 2, [Path("c.yaml")])
    assert list(read.targets) == ["results_stand_in/figures/fig_6_5.pdf"]
    assert read.config == ["stand_in=true"]
    assert states(asked)["fig_6_2"].state == "unplanned"  # it names no raw room


def test_missing_data_are_named_and_chapter_5_needs_none(asked: Reproduction) -> None:
    without = Reproduction(asked.path, {})
    assert list(without.absent) == ["objects"]
    assert "data/CAPOD: no such folder" in without.absent["objects"]
    result = states(without)
    assert (result["fig_6_5"].state, result["fig_5_10"].state) == ("impossible", "missing")
    assert "config/chapter5.yaml" in result["fig_5_10"].note


def test_a_figure_is_done_when_its_file_exists(asked: Reproduction) -> None:
    file = Path("results_stand_in/figures/fig_5_10.pdf")
    file.parent.mkdir(parents=True)
    file.write_text("")
    assert states(asked)["fig_5_10"].line() == f"done        {file}"


def test_the_command_prints_the_list(
    asked: Reproduction, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reproduce", "--config", "c.yaml"]) == 0
    text = capsys.readouterr().out
    assert "data of objects  data/CAPOD: no such folder" in text
    assert main(["reproduce", "--config", "no.yaml"]) == 2
    assert "no.yaml: no such file" in capsys.readouterr().err

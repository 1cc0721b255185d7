"""The checklist of the thesis's figures and tables."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml
from snakemake.cli import parse_args

from jenco2022.checklist import Item, Reproduction
from puckbench.cli import main

CONFIG: dict[str, Any] = {
    "thesis": True,
    "scene_sets": {
        "objects": {
            "loader": "capod",
            "options": {"path": "data/CAPOD"},
            "stand_in": {"loader": "embedded_objects", "limit": 2},
        }
    },
    "datasets": {"capod": {"scene_set": "objects", "make": "sample", "points": 1000}},
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
        *(f"Figure {number}" for number in ("2.1", "2.2", "4.1", "4.2", "4.3", "4.4")),
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


def made(name: str, folder: str = "figures") -> Path:
    """Write the file of a figure or table; its content does not matter here."""
    file = Path("results_stand_in", folder, name)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("")
    return file


def test_what_needs_no_data_of_the_thesis_is_done_when_its_file_exists(
    asked: Reproduction,
) -> None:
    figure, table = made("fig_5_16.pdf"), made("table_4_1.csv", "tables")
    assert states(asked)["fig_5_16"].line() == f"done        {figure}"
    assert states(asked)["table_4_1"].line() == f"done        {table}"


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("fig_6_1", "embedded_objects"),
        ("fig_6_5", "embedded_objects"),
        ("fig_5_10", "virtual scans"),
        ("fig_5_4", "virtual scans"),
    ],
)
def test_what_was_made_of_other_data_than_the_thesiss_is_a_stand_in(
    asked: Reproduction, name: str, data: str
) -> None:
    assert states(asked)[name].state == "missing"
    file = made(f"{name}.pdf")
    assert states(asked)[name].line() == f"stand-in    {file}  # of {data}"


def test_figures_of_the_thesiss_data_and_of_captures_are_done(asked: Reproduction) -> None:
    objects = {"loader": "capod", "options": {"path": "CAPOD"}}
    model = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    Path("CAPOD/class1").mkdir(parents=True)
    Path("CAPOD/CAPOD.cla").write_text("PSB 1\n1 1\n\nHuman 0 1\n1\n")
    Path("CAPOD/class1/m001.obj").write_text(model)
    Path("real.pcap").touch()
    captured = {"runs": 1, "captures": {"real": {"path": "real.pcap"}}}
    changes = {"stand_in": True, "scene_sets": {"objects": objects}, "sensor_study": captured}
    real = Reproduction(asked.path, changes)
    for name in ("fig_6_5", "fig_5_10", "fig_5_4"):
        made(f"{name}.pdf")
    result = states(real)
    assert {result[name].state for name in ("fig_6_5", "fig_5_10")} == {"done"}
    assert result["fig_5_4"].state == "stand-in"  # drawn of the virtual sensor alone


def test_figures_that_show_no_data_are_listed_with_the_reason(asked: Reproduction) -> None:
    made("fig_6_1.pdf")
    items = {item.title: item for item in asked.items()}
    assert items["Figure 4.1"].line() == "no data     photograph of the sensor"
    assert {items[f"Figure 4.{number}"].state for number in (1, 2, 3, 4)} == {"no data"}
    assert items["Figure 2.1"].line() == items["Figure 6.1"].line()  # the same kind of cloud
    assert items["Figure 2.2"].line() == items["Figure 6.2"].line()


def test_the_command_prints_the_list(
    asked: Reproduction, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reproduce", "--config", "c.yaml"]) == 0
    text = capsys.readouterr().out
    assert "data of objects  data/CAPOD: no such folder" in text
    assert "stand-ins        after #: data that replace the thesis's (its captures" in text
    assert main(["reproduce", "--config", "no.yaml"]) == 2
    assert "no.yaml: no such file" in capsys.readouterr().err

"""Which runs are compared with the thesis: its configurations and the default run, no other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from jenco2022.needs import LOADERS
from puckbench.figures.registry import figure_entries
from puckbench.planning.user_files import UserRun
from puckbench.planning.workflow import Workflow
from puckbench.tables.registry import table_entries

ROOT = Path(__file__).parents[2]
OF_THESIS = {
    *("claims", "thesis_medians", "thesis_numbers", "gpcc_scales"),
    *("table_4_1", "table_4_2", "table_5_1", "beside_thesis", "gpcc_grid"),
}
NUMBERED = {name: entry.instead_of for name, entry in figure_entries().items() if entry.instead_of}
SHIPPED = [path.name for path in (ROOT / "config").glob("*.yaml") if path.name[0] != "."]
COMPARED = {"config.yaml", "chapter5.yaml", "thesis.yaml"}
LAID_OVER = {"learned.yaml", "capod_first.yaml", "capod_learned.yaml", "sweeps_reno.yaml"}


def _made(outputs: Any) -> set[str]:
    return {*outputs.tables, *outputs.figures}


def _read(name: str) -> dict[str, Any]:
    config: dict[str, Any] = yaml.safe_load((ROOT / "config" / name).read_text())
    return config


def test_a_run_of_own_files_has_nothing_of_the_thesis(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    points = np.random.default_rng(0).normal(size=(300, 3))
    np.savetxt("sphere.xyz", points / np.linalg.norm(points, axis=1, keepdims=True))
    codecs = ("draco", "gpcc", "gpcc_arena")
    config = UserRun(("sphere.xyz",), codecs, "out", rates=("r1", "r8")).configuration()
    outputs = Workflow(config, check_scenes=True).outputs
    made = _made(outputs)
    assert not made & {*OF_THESIS, *NUMBERED}
    assert {"chamfer_rd", "medians_per_rate", "sampled_object", "summary"} <= made
    assert outputs.first_figures == ["chamfer_rd", "decoding_time"]
    shown = [outputs.figure_style(name)[-1] for name in ("chamfer_rd", "fig_6_6")]
    assert shown == [{}, {}]
    texts = [entry.title + entry.caption for name, entry in table_entries().items() if name in made]
    texts += [
        entry.title + entry.caption for name, entry in figure_entries().items() if name in made
    ]
    assert not [text for text in texts if "hesis" in text]


@pytest.mark.parametrize("name", sorted({*SHIPPED} - LAID_OVER))
def test_shipped_configurations_of_the_thesis_say_so(name: str) -> None:
    config = _read(name)
    loaders = {entry["loader"] for entry in config["scene_sets"].values()}
    assert config.get("thesis", False) == (name in COMPARED)
    assert (name in COMPARED or bool(loaders & {*LOADERS})) == (name in {*COMPARED, "capod.yaml"})


def test_the_default_run_is_compared_and_its_scenes_alone_are_not() -> None:
    config = _read("config.yaml")
    assert {*OF_THESIS, *NUMBERED} - _made(Workflow(config).outputs) == set()
    del config["thesis"]
    outputs = Workflow(config).outputs
    assert not _made(outputs) & {*OF_THESIS, *NUMBERED}
    assert {*NUMBERED.values()} <= _made(outputs)
    assert "residual_statistics" in outputs.tables  # of the sensor study


def test_the_data_of_the_thesis_are_compared_with_it_unless_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data/CAPOD/class1").mkdir(parents=True)
    (tmp_path / "data/CAPOD/CAPOD.cla").write_text("PSB 1\n1 1\n\nAirplane 0 1\n37\n")
    (tmp_path / "data/CAPOD/class1/m37.obj").write_text("v 0 0 0\n")
    config = _read("capod.yaml")
    compared = {"claims", "thesis_medians", "beside_thesis", "fig_6_6"}
    assert compared <= _made(Workflow(config).outputs)
    assert not compared & _made(Workflow({**config, "thesis": False}).outputs)
    assert not compared & _made(Workflow({**config, "thesis": "false"}).outputs)  # --config


def test_options_of_a_figure_hold_under_both_its_names() -> None:
    config = _read("config.yaml")
    config["figures"]["options"] = {"fig_6_6": {"font_size": 7}}
    outputs = Workflow({**config, "thesis": False}).outputs
    assert {"font_size": 7} in outputs.figure_style("chamfer_rd")

"""The thesis's numbers are names for the benchmark's figures: one picture, drawn once in a run."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from puckbench.figures.drawing import draw_files
from puckbench.figures.registry import figure_entries, figure_entry
from puckbench.figures.style import FigureStyle
from puckbench.planning.workflow import Workflow
from tests.support.figures_lookalike import clouds_table, metrics_table

ROOT = Path(__file__).parents[2]
NUMBERED = {name: entry.instead_of for name, entry in figure_entries().items() if entry.instead_of}


@pytest.fixture
def bench() -> Workflow:
    config = yaml.safe_load((ROOT / "config" / "config.yaml").read_text())
    options = {"chamfer_rd": {"font_size": 9, "dpi": 90}, "fig_6_6": {"font_size": 7}}
    return Workflow({**config, "figures": {**config["figures"], "options": options}})


def test_chapter_6_has_nine_figures_of_the_benchmark() -> None:
    assert list(NUMBERED) == [f"fig_6_{number}" for number in range(1, 10)]
    for name, other in NUMBERED.items():
        entry, own = figure_entry(name), figure_entry(other)
        assert (entry.draw, entry.title, entry.category) == (own.draw, own.title, own.category)
        assert entry.caption.startswith(own.caption)
        assert f"Thesis figure {entry.number}." in entry.caption
        assert "hesis" not in own.caption


def test_a_run_draws_the_numbered_ones_and_the_others_on_demand(bench: Workflow) -> None:
    assert {*NUMBERED} <= {*bench.outputs.figures}
    assert not {*NUMBERED.values()} & {*bench.outputs.figures}
    assert {*NUMBERED, *NUMBERED.values()} <= {*bench.outputs.drawable}
    assert bench.outputs.first_figures == ["fig_6_6", "fig_6_9"]


def test_a_numbered_figure_has_the_options_of_the_other_and_its_own(bench: Workflow) -> None:
    styles = [
        FigureStyle.from_config(*bench.outputs.figure_style(name))
        for name in ("chamfer_rd", "fig_6_6")
    ]
    assert [(style.font_size, style.dpi) for style in styles] == [(9, 90), (7, 90)]


@pytest.mark.parametrize("name", ["fig_6_4", "fig_6_6"])
def test_both_names_give_the_same_bytes(name: str, tmp_path: Path) -> None:
    inputs = {"metrics": tmp_path / "metrics.parquet", "clouds": tmp_path / "clouds.parquet"}
    metrics_table(3).to_parquet(inputs["metrics"])
    clouds_table(3).to_parquet(inputs["clouds"])
    files = [tmp_path / "numbered.svg", tmp_path / "own.svg"]
    for each, file in zip((name, NUMBERED[name]), files, strict=True):
        draw_files(each, inputs, [file], FigureStyle())
    assert files[0].read_bytes() == files[1].read_bytes()

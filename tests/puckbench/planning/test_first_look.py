"""Figures of the first codec's results are drawn once, and again only when these change."""

from __future__ import annotations

from typing import Any

from puckbench.planning.workflow import Workflow
from puckbench.steps.step import PlannedStep


def first_look(**codecs: Any) -> PlannedStep:
    config = {
        "scene_sets": {"a": {"loader": "embedded_objects", "limit": 1}},
        "datasets": {"d": {"scene_set": "a", "make": "sample"}},
        "codecs": codecs,
    }
    return Workflow(config).step("first_look")


def test_its_rows_are_those_of_the_first_codec_alone() -> None:
    look = first_look(draco={"rates": ["r2", "r5"]}, gpcc={})
    assert look.step.names == ("metrics/d/airplane_01/draco.parquet",)


def test_other_codecs_rates_do_not_change_its_job() -> None:
    item = first_look(draco={}, gpcc={"rates": ["r1", "r2"]})
    assert first_look(draco={}, gpcc={"rates": ["r1", "r3"]}).key == item.key


def test_it_shows_scaled_clouds_alone() -> None:
    spin = {"scene_set": "s", "make": "scan", "size": "metric", "sweep": {"preset": "spin"}}
    config = {
        "scene_sets": {
            "a": {"loader": "embedded_objects", "limit": 1},
            "s": {"loader": "street", "options": {"streets": 1}},
        },
        "datasets": {"d": {"scene_set": "a", "make": "sample"}, "turns": spin},
        "codecs": {"puck": {}, "draco": {}, "gpcc": {}},  # puck codes turns alone
    }
    outputs = Workflow(config).outputs
    assert outputs.first_places == {"scene_set": {"a"}, "dataset": {"d"}, "codec": {"draco"}}
    assert outputs.first_rows == ("metrics/d/airplane_01/draco.parquet",)
    assert outputs.first_figures
    of_turns = Workflow({**config, "datasets": {"turns": spin}}).outputs
    assert not of_turns.first_figures
    assert not of_turns.first_rows

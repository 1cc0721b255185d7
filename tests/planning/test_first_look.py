"""Figures of the first codec's results are drawn once, and again only when these change."""

from __future__ import annotations

from typing import Any

from puckbench.jobs.first_look import FirstLook
from puckbench.planning.planned_job import PlannedJob
from puckbench.planning.workflow import Workflow


def first_look(**codecs: Any) -> PlannedJob:
    config = {
        "scenes": {"a": {"loader": "embedded_objects", "limit": 1}},
        "datasets": {"d": {"scenes": "a", "make": "sample"}},
        "codecs": codecs,
    }
    found = Workflow(config).outputs.first_look()
    assert found is not None
    return found.job


def test_its_job_records_the_rates_of_the_first_codec_alone() -> None:
    job = first_look(draco={"rates": ["r2", "r5"]}, gpcc={})
    assert FirstLook.model_validate_json(job.record).rates == {"draco/r2": ("r2", "r5")}


def test_other_codecs_rates_do_not_change_its_job() -> None:
    one = first_look(draco={}, gpcc={"rates": ["r1", "r2"]})
    assert first_look(draco={}, gpcc={"rates": ["r1", "r3"]}) == one
    assert first_look(draco={"rates": ["r1"]}, gpcc={"rates": ["r1", "r2"]}) != one

"""How long a run will take: estimates by rule, scaled by a sample of this machine."""

from __future__ import annotations

from typing import Any

import pytest

from puckbench.planning.run_time import SAMPLE_S, job_seconds, machine_sample, run_seconds
from puckbench.planning.workflow import Workflow


def workflow(points: int = 100_000, **codecs: Any) -> Workflow:
    return Workflow(
        {
            "scenes": {"a": {"loader": "embedded_objects", "limit": 1}},
            "datasets": {"d": {"scenes": "a", "make": "sample", "points": points}},
            "codecs": codecs,
            "timing": {"repeats": 1},
        }
    )


def test_every_job_of_a_curve_grows_with_its_points_and_its_rates() -> None:
    short = job_seconds(workflow(draco={"rates": ["r1"]}))
    whole = job_seconds(workflow(draco={}))
    large = job_seconds(workflow(1_000_000, draco={}))
    for rule in ("encode_draco", "evaluate_draco"):
        assert short(rule) < whole(rule) < large(rule)
    for rule in ("prepare", "sample"):
        assert short(rule) == whole(rule) < large(rule)
    assert short("fig_6_5") == large("fig_6_5") > 0


def test_more_cores_take_less_and_a_slower_machine_more() -> None:
    jobs, seconds = {"encode_draco": 4, "fig_6_5": 2}, job_seconds(workflow(draco={}))
    work = 4 * seconds("encode_draco") + 2 * seconds("fig_6_5")
    assert run_seconds(jobs, seconds, 1, SAMPLE_S) == pytest.approx(work)
    assert run_seconds(jobs, seconds, 2, SAMPLE_S) == pytest.approx(work / 2)
    assert run_seconds(jobs, seconds, 2, 3 * SAMPLE_S) == pytest.approx(3 * work / 2)


def test_the_sample_is_short() -> None:
    assert 0.001 < machine_sample() < 60

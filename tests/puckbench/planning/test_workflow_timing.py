"""How timed jobs are started: threads, repetitions, and whether anything runs beside them."""

from __future__ import annotations

from typing import Any

import pytest

from puckbench.planning.workflow import Workflow


def workflow(timing: Any) -> Workflow:
    config = {
        "scene_sets": {"a": {"loader": "embedded_objects", "limit": 1}},
        "datasets": {"d": {"scene_set": "a", "make": "sample", "truth": False}},
        "timing": timing,
    }
    return Workflow(config)


@pytest.mark.parametrize(
    ("timing", "cores", "taken"),
    [
        ({}, 8, 1),
        ({"threads": 2}, 8, 2),
        ("exclusive", 8, 8),
        ({"exclusive": True, "threads": 4}, 2, 4),
        ("exclusive", None, 1),
    ],
)
def test_a_timed_job_takes_all_cores_when_it_is_to_run_alone(
    timing: Any, cores: int | None, taken: int
) -> None:
    assert workflow(timing).costs.cores(cores) == taken


def test_the_record_says_how_it_is_timed() -> None:
    alone = workflow({"exclusive": True, "repeats": 5})
    ((dataset, cloud, codec),) = alone.plan.curves
    names = {"dataset": dataset, "cloud": cloud, "codec": codec}
    coded = alone.step("encode", **names).step
    assert (coded.repeats, coded.exclusive) == (5, True)
    assert not workflow({}).step("encode", **names).step.exclusive
    measured = alone.step("evaluate", **names).step
    assert (measured.repeats, measured.exclusive) == (5, True)
    assert (measured.dataset, measured.peak, measured.views) == ("d", None, 0)
    assert workflow({"threads": 3}).costs.threads_environment["OMP_NUM_THREADS"] == "3"

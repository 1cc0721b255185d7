"""How timed jobs are started: threads, repetitions, and whether anything runs beside them."""

from __future__ import annotations

from typing import Any

import pytest

from puckbench.jobs.encode_curve import EncodeCurve
from puckbench.jobs.evaluate import EvaluateCurve
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
    assert workflow(timing).coding.cores(cores) == taken


def test_the_record_says_how_it_is_timed() -> None:
    alone = workflow({"exclusive": True, "repeats": 5}).coding
    (curve,) = alone.plan.curves
    coded = EncodeCurve.model_validate_json(alone.encode(*curve).record)
    assert (coded.repeats, coded.alone) == (5, True)
    assert not EncodeCurve.model_validate_json(workflow({}).coding.encode(*curve).record).alone
    measured = EvaluateCurve.model_validate_json(alone.evaluate(*curve).record)
    assert (measured.repeats, measured.alone) == (5, True)
    assert (measured.dataset, measured.peak, measured.views) == ("d", 1023, 0)
    assert workflow({"threads": 3}).coding.threads_environment["OMP_NUM_THREADS"] == "3"

"""How timed jobs are started: threads, repetitions, and whether anything runs beside them."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import pytest

from puckbench.planning.workflow import Workflow

SCHEMA = Path(__file__).parents[2] / "workflow" / "schemas" / "config.schema.yaml"


def workflow(timing: Any) -> Workflow:
    config = {
        "scenes": {"a": {"loader": "embedded_objects", "limit": 1}},
        "datasets": {"d": {"scenes": "a", "make": "sample", "truth": False}},
        "timing": timing,
    }
    return Workflow(config, SCHEMA)


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
    assert workflow(timing).timed_cores(cores) == taken


def test_the_arguments_say_how_it_is_timed() -> None:
    alone = workflow({"exclusive": True, "repeats": 5})
    words = shlex.split(alone.encode_arguments("draco", "r4"))
    assert words[words.index("--repeats") + 1] == "5"
    assert "--alone" in words
    assert "--alone" not in workflow({}).encode_arguments("draco", "r4")
    cell = shlex.split(alone.evaluate_arguments("d", "airplane_01", "draco", "r4"))
    assert {"--alone", "--dataset", "--peak", "--views"} <= set(cell)
    assert "OMP_NUM_THREADS=3" in workflow({"threads": 3}).timed

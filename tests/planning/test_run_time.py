"""How long a run will take: estimates by rule, scaled by a sample of this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from puckbench.planning.run_time import (
    SAMPLE_S,
    compiling_seconds,
    job_seconds,
    machine_sample,
    run_seconds,
)
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
    for rule in ("encode", "evaluate"):
        assert short(rule) < whole(rule) < large(rule)
    for rule in ("prepare", "sample"):
        assert short(rule) == whole(rule) < large(rule)
    assert short("figure") == large("figure") > 0


def test_attributes_take_longer_than_positions_alone() -> None:
    bare = job_seconds(workflow(gpcc={}))
    both = job_seconds(workflow(gpcc={"options": {"attributes": True}}))
    assert both("encode") > 1.5 * bare("encode")


def test_more_cores_take_less_and_a_slower_machine_more() -> None:
    jobs, seconds = {"encode": 4, "figure": 2}, job_seconds(workflow(draco={}))
    work = 4 * seconds("encode") + 2 * seconds("figure")
    assert run_seconds(jobs, seconds, 1, SAMPLE_S) == pytest.approx(work)
    assert run_seconds(jobs, seconds, 2, SAMPLE_S) == pytest.approx(work / 2)
    assert run_seconds(jobs, seconds, 2, 3 * SAMPLE_S) == pytest.approx(3 * work / 2)


def test_a_codec_that_searches_takes_longer_to_encode_than_to_measure() -> None:
    seconds = job_seconds(workflow(primitives={"rates": ["r8"]}))
    assert seconds("encode") > 3 * seconds("decode_shown")


def test_a_machine_where_nothing_was_compiled_takes_longer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    fresh = compiling_seconds(workflow(draco={}, gpcc={}))
    assert fresh > compiling_seconds(workflow(draco={})) > 0
    assert run_seconds({}, {}.__getitem__, 2, SAMPLE_S, fresh) == pytest.approx(fresh / 2)
    (tmp_path / "numba-0123456789ab").mkdir()
    assert compiling_seconds(workflow(draco={})) == 0


def test_the_sample_is_short() -> None:
    assert 0.001 < machine_sample() < 60

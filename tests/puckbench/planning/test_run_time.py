"""How long a run will take: estimates by rule."""

from __future__ import annotations

from typing import Any

from puckbench.planning.run_time import job_seconds
from puckbench.planning.workflow import Workflow


def workflow(points: int = 100_000, **codecs: Any) -> Workflow:
    return Workflow(
        {
            "scene_sets": {"a": {"loader": "embedded_objects", "limit": 1}},
            "datasets": {"d": {"scene_set": "a", "make": "sample", "points": points}},
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


def test_a_codec_that_searches_takes_longer_to_encode_than_to_measure() -> None:
    seconds = job_seconds(workflow(primitives={"rates": ["r8"]}))
    assert seconds("encode") > 3 * seconds("decode_shown")

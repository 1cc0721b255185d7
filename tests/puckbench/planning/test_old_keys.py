"""Configurations with the old names of keys plan the same jobs as with the new ones."""

from __future__ import annotations

from typing import Any

import pytest

from pointkit.errors import InputError
from puckbench.core.renamed_keys import renaming_line, with_new_keys
from puckbench.planning.config import checked
from puckbench.planning.workflow import Workflow
from tests.support.every_job import jobs_of

SCAN = {"make": "scan", "errors": "vlp16", "sweep": {"duration_s": 0.02}}
DRIVE = {"rates": ["50mm"], "codecs": ["draco"], "tasks": {"registration": {}}}
PUSH = {
    "sweep": {"preset": "spin", "trajectory": [[0, 0, 0, 0, 0, 0, 0], [0.4, 0, 0.3, 0, 0, 0, 0]]}
}


def _config(of_run: str, of_entry: str, **changes: Any) -> dict[str, Any]:
    return {
        of_run: {
            "rooms": {"loader": "embedded_rooms", "select": ["office_1"]},
            "objects": {"loader": "embedded_objects", "limit": 1},
        },
        "datasets": {
            "sampled": {
                of_entry: "rooms",
                "make": "sample",
                "points": 10,
                "stand_in": {of_entry: "objects"},
            },
            "scanned": {of_entry: "rooms", **SCAN},
        },
        "drives": {"push": {of_entry: "rooms", **DRIVE, **PUSH}},
        "codecs": {"draco": {"rates": ["r1"], "metric_rates": ["50mm"]}},
        **changes,
    }


@pytest.mark.parametrize("stand_in", [False, True])
def test_the_same_jobs_are_planned(stand_in: bool) -> None:
    new, old = (
        {name: (job.key, job.code) for name, job in jobs_of(Workflow(config)).items()}
        for config in (
            _config("scene_sets", "scene_set", stand_in=stand_in),
            _config("scenes", "scenes", stand_in=stand_in),
        )
    )
    assert {"scan scanned", "drive push", "report"} < new.keys()
    assert new == old


def test_a_checked_configuration_has_the_new_keys() -> None:
    config = checked(_config("scenes", "scenes")).as_json()
    assert "scenes" not in config.keys() | config["datasets"]["scanned"].keys()
    assert config == checked(_config("scene_sets", "scene_set")).as_json()
    assert with_new_keys(config) == config


@pytest.mark.parametrize(
    ("of_run", "of_entry", "line"),
    [
        ("scene_sets", "scene_set", ""),
        ("scenes", "scene_set", "configuration: 'scenes' is now 'scene_sets'"),
        (
            "scene_sets",
            "scenes",
            "configuration: 'scenes' of a data set or drive is now 'scene_set'",
        ),
        (
            "scenes",
            "scenes",
            "configuration: 'scenes' is now 'scene_sets'; "
            "'scenes' of a data set or drive is now 'scene_set'",
        ),
    ],
)
def test_one_line_tells_the_new_names(of_run: str, of_entry: str, line: str) -> None:
    assert renaming_line(_config(of_run, of_entry)) == line


def test_an_old_key_beside_the_new_one_is_refused() -> None:
    with pytest.raises(InputError, match="the configuration has 'scenes' and 'scene_sets', which"):
        checked(_config("scenes", "scene_set", scene_sets={}))
    config = _config("scene_sets", "scene_set")
    config["drives"]["push"]["scenes"] = "rooms"
    with pytest.raises(InputError, match=r"drives\.push has 'scenes' and 'scene_set', which"):
        checked(config)


def test_values_of_a_wrong_type_are_left_to_the_check() -> None:
    assert with_new_keys({"scenes": 3, "datasets": [1], "drives": {"a": 1}}) == {
        "scene_sets": 3,
        "datasets": [1],
        "drives": {"a": 1},
    }

"""What a data set's settings make of its jobs: their arguments and memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from puckbench.core.errors import InputError
from puckbench.planning.workflow import Workflow

SCHEMA = Path(__file__).parents[2] / "workflow" / "schemas" / "config.schema.yaml"


def workflow(**settings: Any) -> Workflow:
    rooms = {"loader": "embedded_rooms", "select": ["office_1"]}
    dataset = {"scenes": "rooms", "make": "scan", **settings}
    return Workflow({"scenes": {"rooms": rooms}, "datasets": {"d": dataset}}, SCHEMA)


def test_a_scan_from_anywhere_is_asked_for() -> None:
    assert "--anywhere" not in workflow().scan_arguments("d")
    assert workflow(anywhere=True).scan_arguments("d").endswith(" --anywhere")


def test_the_peak_of_a_grid_is_each_clouds_own() -> None:
    cell = ("d", "office_1", "draco", "r1")
    assert "--peak 511 " in workflow(size=512).evaluate_arguments(*cell)
    assert "--peak" not in workflow(size="grid", make="cloud").evaluate_arguments(*cell)


def test_only_clouds_come_on_a_grid() -> None:
    with pytest.raises(InputError, match=r"datasets.d.size: only captured clouds came on a grid"):
        workflow(size="grid")


def test_pictures_need_memory() -> None:
    more = workflow(views=1920).cell_memory_mb - workflow().cell_memory_mb
    assert more == pytest.approx(1920**2 * 100e-6, abs=1)

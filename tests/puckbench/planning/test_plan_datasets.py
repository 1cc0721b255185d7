"""What a data set's settings make of its jobs: their settings and memory."""

from __future__ import annotations

from typing import Any

import pytest

from pointkit.errors import InputError
from puckbench.planning.workflow import Workflow


def workflow(loader: str = "embedded_rooms", **settings: Any) -> Workflow:
    rooms = {"loader": loader, "select": ["office_1"]}
    dataset = {"scene_set": "rooms", "make": "scan", **settings}
    return Workflow({"scene_sets": {"rooms": rooms}, "datasets": {"d": dataset}})


def test_a_scan_from_anywhere_is_asked_for() -> None:
    assert not workflow().step("scan", dataset="d", cloud="office_1").step.anywhere
    assert workflow(anywhere=True).step("scan", dataset="d", cloud="office_1").step.anywhere


def test_each_seed_has_a_cloud_of_every_scene() -> None:
    bench = workflow(seeds=[3, 8])
    assert bench.plan.clouds == (("d", "office_1-3"), ("d", "office_1-8"))
    for cloud, seed in (("office_1-3", 3), ("office_1-8", 8)):
        assert bench.step("scan", dataset="d", cloud=cloud).step.seed == seed
        assert bench.files.scene("d", cloud).endswith("scenes/rooms/office_1.ply")
    sampled = workflow(seeds=[3, 8], make="sample")
    for cloud, seed in (("office_1-3", 3), ("office_1-8", 8)):
        assert sampled.step("sample", dataset="d", cloud=cloud).step.seed == seed


@pytest.mark.parametrize(
    ("settings", "reason"),
    [({"seed": 1, "seeds": [1]}, "a seed too"), ({"make": "cloud", "seeds": [1]}, "have none")],
)
def test_seeds_that_would_do_nothing_are_refused(settings: dict[str, Any], reason: str) -> None:
    with pytest.raises(InputError, match=f"seeds: .*{reason}"):
        workflow(**settings)


def test_meshes_are_not_coded_as_clouds() -> None:
    fault = r"datasets.d.make is 'cloud', but embedded_rooms has meshes: sample or scan"
    with pytest.raises(InputError, match=fault):
        workflow(make="cloud")


def test_only_clouds_come_on_a_grid() -> None:
    with pytest.raises(InputError, match=r"datasets.d.size: a grid is only for captured clouds"):
        workflow(size="grid")


def test_pictures_need_memory() -> None:
    names = {"dataset": "d", "cloud": "office_1", "codec": "draco"}
    more = workflow(views=1920).step("evaluate", **names).memory_mb
    more -= workflow().step("evaluate", **names).memory_mb
    assert more == pytest.approx(1920**2 * 100e-6, abs=1)

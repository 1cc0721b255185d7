"""Results that a workflow can make, by the values of Snakemake's wildcards."""

from __future__ import annotations

import pytest

from pointkit.errors import InputError
from puckbench.planning.workflow import Workflow

ROOMS = {"scene_set": "rooms", "rates": ["50mm"], "codecs": ["draco"]}
SWEEP = {"preset": "spin", "trajectory": [[0, 0, 0, 0, 0, 0, 0], [0.4, 0, 0.3, 0, 0, 0, 0]]}
CONFIG = {
    "scene_sets": {"rooms": {"loader": "embedded_rooms", "select": ["office_1"]}},
    "datasets": {"d": {"scene_set": "rooms", "make": "sample", "points": 10, "codecs": ["draco"]}},
    "drives": {"push": {**ROOMS, "sweep": SWEEP}},
    "codecs": {"draco": {"rates": ["r1", "r8"]}, "gpcc": {}},
}


@pytest.fixture(scope="module")
def workflow() -> Workflow:
    return Workflow(CONFIG)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ("dataset=d cloud=office_1 codec=draco rate=r99", r"codec draco has no rate 'r99' \(known"),
        ("dataset=d cloud=office_1 codec=gpcc rate=r1", "codec gpcc does not code the data set d"),
        ("dataset=d cloud=ofice_1", "data set d has no cloud 'ofice_1'; did you mean 'office_1'"),
        ("drives=push drive=x codec=draco", "push has no drive 'x'"),
        ("drives=push drive=office_1-1 codec=gpcc", "codec gpcc does not code push"),
        ("scene_set=rooms scene=x", "rooms has no scene 'x'"),
    ],
)
def test_a_result_that_a_plan_lacks_is_told_in_one_line(
    names: str, said: str, workflow: Workflow
) -> None:
    with pytest.raises(InputError, match=f"^{said}"):
        workflow.check_names(dict(name.split("=") for name in names.split()))


@pytest.mark.parametrize(
    "names",
    [
        "dataset=d cloud=office_1 codec=draco rate=r8",
        "drives=push drive=office_1-1 codec=draco",
        "drives=push drive=office_1-1",
        "scene_set=rooms scene=storage_1",
        "figure=fig_6_6",
    ],
)
def test_a_result_of_a_plan_is_known(names: str, workflow: Workflow) -> None:
    workflow.check_names(dict(name.split("=") for name in names.split()))

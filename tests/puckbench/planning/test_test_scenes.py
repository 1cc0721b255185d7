"""No scene on which codecs are measured is one on which a codec was trained, chosen or tuned."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path

import pytest

from puckbench.planning.config import checked, read_config
from puckbench.planning.plan import Plan
from tests.support.pages import ROOT

MEASURED = ("config", "evidence", "sweeps", "drives")
"""Configurations whose results the pages of codecs use."""
TUNED = {("embedded_rooms", "storage_1")}
"""Scenes on which settings of codecs were chosen: `primitives` (docs/notes/primitives.md)."""
Scene = tuple[str, int, str]


def scenes_of(config: Path) -> set[Scene]:
    """Loader, seed and name of each generated scene from which a configuration makes clouds."""
    plan = Plan(checked(read_config(config)))
    uses = (*plan.datasets.values(), *plan.config.drives.values())
    return {
        (chosen.loader, chosen.seed, name)
        for chosen in (plan.scene_sets[use.scene_set] for use in uses)
        for name in chosen.chosen
    }


@pytest.fixture(scope="module")
def trained() -> set[Scene]:
    return scenes_of(ROOT / "config" / "train.yaml")


def names_on_cards() -> set[str]:
    """The names of all scenes on which the shipped weights were trained or validated."""
    names = set()
    for card in (files("pcc_networks") / "weights").iterdir():
        if card.name.endswith(".json"):
            content = json.loads(card.read_text())
            clouds = [*content["data"], *content["validation"]["data"]]
            names |= {Path(cloud).stem for cloud in clouds}
    return names


def test_the_training_configuration_names_the_scenes_on_the_cards(trained: set[Scene]) -> None:
    assert names_on_cards() == {name for _, _, name in trained}


@pytest.mark.parametrize("config", MEASURED)
def test_measured_scenes_are_none_of_the_training(config: str, trained: set[Scene]) -> None:
    measured = scenes_of(ROOT / "config" / f"{config}.yaml")
    assert measured & trained == set()
    assert {(loader, name) for loader, _, name in measured} & TUNED == set()

"""config/train.yaml asks for sets of the kind that is shipped: networks, settings, clouds."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from pcc_networks import catalogue
from puckbench.codecs.rates import scaled_rates
from puckbench.codecs.registry import open_codec, open_training
from puckbench.planning.plan import TrainingPlan
from puckbench.planning.workflow import Workflow
from puckbench.steps.validation import faults

ROOT = Path(__file__).parents[3]
CONFIG = ROOT / "config" / "train.yaml"
SHIPPED = ["pcgcv1_mixed", "pcgcv2_objects", "pcgcv2_rooms", "sparse_octree_net_rooms"]
IN_ONE_GO = {"steps", "seed", "learning_rate", "final_learning_rate", "rate_warm_up", "symmetries"}
"""Settings in which one training differs from the several of which a shipped set is the last."""

pytestmark = pytest.mark.usefixtures("one_thread")


@cache
def planned(name: str) -> TrainingPlan:
    config = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
    return Workflow(config).plan.trainings[name]


def header_of(name: str) -> catalogue.WeightsHeader:
    return catalogue.header_of(catalogue.shipped()[name])


def plain(settings: Any) -> dict[str, Any]:
    """As JSON has them."""
    result: dict[str, Any] = json.loads(json.dumps(settings.model_dump()))
    return result


def test_every_shipped_set_can_be_trained_again() -> None:
    asked = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))["train"]
    assert sorted(catalogue.shipped()) == SHIPPED == sorted(asked)


@pytest.mark.parametrize("name", SHIPPED)
def test_settings_are_those_of_the_shipped_set(name: str) -> None:
    plan, card = planned(name), header_of(name).card
    assert plan.codec == card["codec"]
    settings = plain(open_training(plan.codec, plan.entry, plan.settings))
    kept = settings.keys() - IN_ONE_GO
    assert {key: settings[key] for key in kept} == {key: card[key] for key in kept}


@pytest.mark.parametrize("name", SHIPPED)
def test_clouds_are_those_of_the_shipped_set(name: str) -> None:
    plan, data = planned(name), header_of(name).card["data"]
    several = len({dataset for dataset, _ in plan.clouds}) > 1
    expected = {
        f"{dataset}/{cloud}.ply" if several else f"{cloud}.ply" for dataset, cloud in plan.clouds
    }
    assert expected == set(data)
    assert not {cloud for _, cloud in plan.clouds} & {cloud for _, cloud in plan.validate}


@pytest.mark.parametrize("name", SHIPPED)
def test_the_network_is_that_of_the_shipped_set(name: str) -> None:
    plan, header = planned(name), header_of(name)
    with open_training(plan.codec, plan.entry, plan.settings).trainer() as trainer:
        assert {**plain(trainer.model.shape), **header.shape} == plain(trainer.model.shape)


@pytest.mark.parametrize("name", SHIPPED)
def test_cards_tell_what_the_sets_do_on_the_clouds_they_are_validated_on(name: str) -> None:
    """At each rate of the codec; more bits bring less distortion, at every rate."""
    plan, path = planned(name), catalogue.shipped()[name].with_suffix(".json")
    card = json.loads(path.read_text(encoding="utf-8"))
    validation = card.pop("validation")
    assert card == header_of(name).card
    assert validation["data"] == [f"{dataset}/{cloud}.ply" for dataset, cloud in plan.validate]
    assert list(validation["rates"]) == list(scaled_rates(open_codec(plan.codec).rates))
    assert validation["faults"] == faults(validation["rates"]) == []

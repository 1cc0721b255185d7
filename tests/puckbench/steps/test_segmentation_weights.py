"""The training of networks of segmentation: its data, checkpoints, card, and what is shipped."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml

from cloud_files.clouds import write_cloud
from lidar_segmentation import class_map, confusion, mean_iou, open_network
from pcc_networks.training import train
from pointkit.errors import InputError
from pointkit.files import read_json
from pointkit.geometry.cloud import PointCloud
from puckbench.geometry.labels import OF_SCENE, described_classes
from puckbench.planning.workflow import Workflow
from puckbench.steps.segmentation_trainer import segmentation_trainer
from puckbench.steps.segmentation_weights import (
    TrainSegmentation,
    open_segmentation_training,
    read_labelled,
)
from tests.support.in_process import prepared
from virtual_lidar import make_room, make_street

ROOT = Path(__file__).parents[3]
CONFIG = ROOT / "config" / "perception_train.yaml"
SETTINGS: dict[str, Any] = {
    "labels": "rooms", "cells": 32, "bins": 6, "bin_m": 0.5, "channels": [4, 4, 4, 4], "hidden": 8,
    "crop_cells": 16, "points": 200, "batch_size": 1, "seed": 1,
}  # fmt: skip

pytestmark = pytest.mark.usefixtures("one_thread")


def labelled(path: Path, seed: int) -> Path:
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-5, 5, (400, 3))
    labels = rng.integers(-1, 2, 400).astype(np.int32)
    about = described_classes(["floor", "board"], OF_SCENE)
    path.parent.mkdir(exist_ok=True)
    write_cloud(path, PointCloud(xyz, labels=labels, about=about))
    return path


@pytest.fixture
def clouds(tmp_path: Path) -> tuple[Path, ...]:
    return tuple(labelled(tmp_path / "data" / f"{name}.ply", name) for name in (1, 2))


def test_labels_become_classes_by_their_names(clouds: tuple[Path, ...]) -> None:
    scan = read_labelled(clouds[0], "rooms")
    rng = np.random.default_rng(1)
    xyz = rng.uniform(-5, 5, (400, 3))
    labels = rng.integers(-1, 2, 400)
    floor, wall = (class_map("rooms").classes.index(name) for name in ("floor", "wall"))
    assert scan.classes.tolist() == np.choose(labels + 1, [255, floor, wall]).tolist()
    np.testing.assert_allclose(scan.xyz, xyz, atol=1e-5)


def test_a_training_leaves_weights_a_curve_and_a_card(
    clouds: tuple[Path, ...], tmp_path: Path
) -> None:
    weights = tmp_path / "small.safetensors"
    step = TrainSegmentation(options={**SETTINGS, "steps": 6})
    card = step.run(clouds, weights, clouds[:1])
    assert card["data"] == {"data": ["1", "2"]}
    assert list(card["validation"]) == ["data"]
    scores = card["validation"]["data"]
    assert scores["miou_of_clouds"] == {"1": scores["miou"]}
    assert set(scores["iou"]) == {"floor", "wall"}
    assert card == read_json(weights.with_suffix(".json")) == open_network(weights).card
    assert len(weights.with_suffix(".csv").read_text().splitlines()) == 7
    with pytest.raises(InputError, match=r"the saved training has other settings or data$"):
        TrainSegmentation(options={**SETTINGS, "steps": 7}).run(clouds, weights)


def test_a_resumed_training_equals_an_uninterrupted_one(
    clouds: tuple[Path, ...], tmp_path: Path
) -> None:
    settings = open_segmentation_training({**SETTINGS, "steps": 6})
    examples = settings.examples([read_labelled(path, "rooms") for path in clouds])

    def trained(name: str, steps: int) -> dict[str, Any]:
        def stop(step: int, _loss: float) -> None:
            if step == steps:
                raise KeyboardInterrupt

        trainer = segmentation_trainer(settings, examples)
        with suppress(KeyboardInterrupt):
            train(trainer, examples.batch, tmp_path / name, 2, stop)
        return trainer.model.state_dict()

    whole = trained("whole.pt", 6)
    trained("resumed.pt", 5)
    resumed = trained("resumed.pt", 6)
    assert all(torch.equal(whole[name], resumed[name]) for name in whole)


@pytest.mark.parametrize(
    ("names", "labels", "message"),
    [
        (["floor", "lawn"], OF_SCENE, "labels rooms: no label 'lawn' (known: floor, "),
        (["floor", "wall"], "nowhere", "unknown label set 'nowhere' (known: streets, "),
        (["floor"], OF_SCENE, "label 1: the cloud has 1 classes"),
    ],
)
def test_clouds_without_classes_of_the_network_end_in_one_line(
    tmp_path: Path, names: list[str], labels: str, message: str
) -> None:
    cloud = PointCloud(np.zeros((2, 3)), labels=np.array([0, 1], np.int32))
    path = tmp_path / "cloud.ply"
    write_cloud(path, replace(cloud, about=described_classes(names, labels)))
    with pytest.raises(InputError) as error:
        read_labelled(path, "rooms")
    assert str(error.value).startswith(f"{path}: {message}")


def test_every_class_of_the_generated_scenes_is_a_class_of_a_network() -> None:
    scenes = {"streets": [make_street("street_1", 0, 60.0)]}
    names = ("office_2", "office_3", "hallway_3", "gallery_1")  # columns, sofas, beams
    scenes["rooms"] = [make_room(name, 0, detail=0.1) for name in names]
    for labels, meshes in scenes.items():
        found = {each.semantic for mesh in meshes for each in mesh.labels.objects}
        numbers = class_map(labels).of(sorted(found))
        assert set(numbers.tolist()) == {*range(len(class_map(labels).classes))}
        assert found == set(class_map(labels).numbers)


@cache
def planned() -> Workflow:
    return Workflow(yaml.safe_load(CONFIG.read_text(encoding="utf-8")))


def scene_of(dataset: str, cloud: str) -> tuple[str, int, str, str]:
    """What the scene of a cloud depends on."""
    data = planned().plan.datasets[dataset]
    scenes = planned().plan.scene_sets[data.scene_set]
    return scenes.loader, scenes.seed, str(sorted(scenes.options.items())), cloud


@pytest.mark.parametrize("name", ["streets", "rooms"])
def test_the_shipped_networks_are_those_of_the_configuration(name: str) -> None:
    training, card = planned().plan.segmentations[name], open_network(name).card
    settings = json.loads(open_segmentation_training(training.settings).model_dump_json())
    assert {key: card[key] for key in settings} == settings
    data: dict[str, list[str]] = {}
    for dataset, cloud in training.clouds:
        data.setdefault(dataset, []).append(cloud)
    assert card["data"] == data
    seen = {scene_of(*cloud) for cloud in training.clouds}
    assert not seen & {scene_of(*cloud) for cloud in training.validate}
    measured = {
        (dataset, cloud)
        for dataset, scores in card["validation"].items()
        for cloud in scores["miou_of_clouds"]
    }
    assert measured == set(training.validate)


def test_rooms_that_measure_have_other_names_and_streets_other_seeds() -> None:
    plan = planned().plan
    for training in plan.segmentations.values():
        seeds = [
            {scene_of(*cloud)[1] for cloud in part} for part in (training.clouds, training.validate)
        ]
        assert not seeds[0] & seeds[1]
    rooms = plan.segmentations["rooms"]
    assert not {name for _, name in rooms.clouds} & {name for _, name in rooms.validate}


@pytest.mark.parametrize(
    ("name", "dataset", "cloud"),
    [("streets", "held_out_vlp16", "street_1"), ("rooms", "held_out_rooms_vlp16", "office_1")],
)
def test_a_shipped_network_has_the_score_on_its_card(
    name: str, dataset: str, cloud: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scan, network = read_labelled(prepared(planned(), dataset, cloud), name), open_network(name)
    matrix = confusion(scan.classes, network.predict(scan.xyz), len(network.classes))
    expected = network.card["validation"][dataset]["miou_of_clouds"][cloud]
    assert mean_iou(matrix) == pytest.approx(expected, abs=0.001)

"""Training in the workflow: from scenes to weights, which its own codecs can then use."""

from __future__ import annotations

from typing import Any

import pytest
import yaml

from pointkit.files import read_json
from puckbench.results.row_files import read_rows
from tests.support.bench import CONFIG, ROOT, Bench

SETTINGS = {"lmbdas": [1, 4], "channels": [4, 8, 8, 8], "batch_size": 1, "cube_size": 1024}
TRAININGS: dict[str, Any] = {
    "tiny": {
        "codec": "pcgcv2_plus",
        "datasets": ["objects"],
        "validate": ["raw"],
        "steps": 2,
        "options": SETTINGS,
    },
    "again": {
        "codec": "pcgcv2_plus",
        "datasets": ["objects", "raw"],
        "steps": 1,
        "start": "tiny",
        "options": {**SETTINGS, "min_kept_fraction": 0.5},
    },
}


@pytest.fixture
def training(fresh: Bench) -> Bench:
    """A folder where nothing has been made, configured for trainings alone."""
    fresh.configure({"train": TRAININGS, "figures": {}, "sensor_study": None})
    return fresh


def test_weights_are_trained_from_scenes_and_used(training: Bench) -> None:
    training.made("train")
    weights = training.results / "weights"
    card = read_json(weights / "tiny.json")
    assert card["data"] == ["chair_01.ply"]
    assert card["validation"]["data"] == ["copy_room_1.ply"]
    assert list(card["validation"]["rates"]) == [f"r{number}" for number in range(1, 7)]
    again = read_json(weights / "again.json")
    assert again["data"] == ["objects/chair_01.ply", "raw/copy_room_1.ply"]
    assert again["start"] == "tiny"
    assert len((weights / "tiny.csv").read_text().splitlines()) == 3
    assert training.planned("train") == {}
    changed = {**TRAININGS, "again": {**TRAININGS["again"], "steps": 3}}
    training.configure({"train": changed, "figures": {}, "sensor_study": None})
    assert training.planned("train") == {"weights": 1}
    codec = {"options": {"weights": str(weights / "tiny.safetensors")}, "rates": ["r2", "r4", "r6"]}
    training.configure({"codecs": {"pcgcv2_plus": codec}, "figures": {}, "sensor_study": None})
    rows = training.results / "metrics" / "objects" / "chair_01" / "pcgcv2_plus.parquet"
    training.made(str(rows.relative_to(training.folder)))
    assert read_rows([rows])[0]["weights"].startswith("tiny ")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"datasets": ["nowhere"]}, "train.tiny.datasets: no data set 'nowhere' (known: clean"),
        ({"validate": ["nowhere"]}, "train.tiny.validate: no data set 'nowhere'"),
        ({"start": "nowhere"}, "train.tiny: nowhere: no such folder of weights"),
        ({"codec": "draco"}, "train.tiny: codec draco: there is nothing to train"),
        (
            {"options": {"channels": [3]}},
            "train.tiny: codec pcgcv2_plus: training: channels.0 is 3, but must be a multiple of 4",
        ),
    ],
)
def test_a_training_that_cannot_be_ends_in_one_line(
    fresh: Bench, changes: dict[str, Any], message: str
) -> None:
    fresh.configure({"train": {"tiny": {**TRAININGS["tiny"], **changes}}})
    done = fresh.snakemake("--dry-run", "train")
    assert done.returncode == 2
    assert message in done.stderr


def test_weights_that_are_not_there_end_in_one_line(fresh: Bench) -> None:
    fresh.configure({"codecs": {"pcgcv2_plus": {"options": {"weights": "nowhere"}}}})
    done = fresh.snakemake("--dry-run")
    assert done.returncode == 2
    assert "codecs.pcgcv2_plus: nowhere: no such folder of weights" in done.stderr


def test_the_shipped_weights_are_planned(fresh: Bench) -> None:
    config = (ROOT / "config" / "train.yaml").read_text(encoding="utf-8")
    (fresh.folder / "config.yaml").write_text(config)
    jobs = fresh.planned("train")
    assert jobs["weights"] == len(yaml.safe_load(config)["train"]) == 4
    assert "encode" not in jobs


SEGMENTATION: dict[str, Any] = {
    "datasets": ["turns"],
    "validate": ["turns"],
    "steps": 2,
    "options": {
        "labels": "rooms", "cells": 32, "crop_cells": 16, "bins": 4, "channels": [4, 4, 4, 4],
        "hidden": 8, "points": 100,
    },
}  # fmt: skip
TURNS = {
    "scene_set": "rooms",
    "make": "scan",
    "size": "metric",
    "sweep": {"preset": "spin", "azimuth_step_deg": 4.0},
}


def test_a_network_of_segmentation_is_trained_from_scenes(fresh: Bench) -> None:
    entry = {**SEGMENTATION, "seeds": [3]}
    others = {"figures": {}, "sensor_study": None}
    datasets = {"turns": TURNS}
    fresh.configure({**others, "datasets": datasets, "train_segmentation": {"rooms": entry}})
    fresh.made("train")
    folder = fresh.results / "segmentation"
    card = read_json(folder / "rooms-3.json")
    assert (card["seed"], card["data"]) == (3, {"turns": ["copy_room_1"]})
    assert 0 <= card["validation"]["turns"]["miou"] <= 1
    assert fresh.planned("train") == {}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"datasets": ["nowhere"]}, "train_segmentation.rooms.datasets: no data set 'nowhere'"),
        ({"datasets": ["objects"]}, "train_segmentation.rooms: the data set objects is not in met"),
        ({"options": {"labels": "roms"}}, "train_segmentation.rooms: unknown label set 'roms'"),
        ({"options": {"bins": 0}}, "train_segmentation.rooms: training: bins is 0, but must be"),
    ],
)
def test_a_training_of_segmentation_that_cannot_be_ends_in_one_line(
    fresh: Bench, changes: dict[str, Any], message: str
) -> None:
    entry = {**SEGMENTATION, **changes}
    datasets = {**CONFIG["datasets"], "turns": TURNS}
    fresh.configure({"datasets": datasets, "train_segmentation": {"rooms": entry}})
    done = fresh.snakemake("--dry-run", "train")
    assert done.returncode == 2
    assert message in done.stderr

"""What a configuration asks for: scene sets, data sets with their clouds, codecs with their rates.

The workflow reads this to lay out its graph; it imports nothing heavy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from puckbench.codecs import registry as codecs
from puckbench.config import Config
from puckbench.datasets.registry import open_scene_set
from puckbench.datasets.scene import SceneSet
from puckbench.errors import InputError
from puckbench.sensor import load_sensor, open_error_model, open_sweep


@dataclass(frozen=True)
class ScenePlan:
    """A scene set of the configuration, opened, with the scenes chosen from it."""

    name: str
    loader: str
    seed: int
    options: dict[str, Any]
    scenes: SceneSet
    chosen: tuple[str, ...]

    def files(self, scene: str) -> list[str]:
        """Files that the scene is read from; none for generated scenes."""
        return [str(path) for path in self.scenes.files(scene)]


@dataclass(frozen=True)
class DataSetPlan:
    """A data set of the configuration and the clouds in it.

    points: how many a cloud is expected to have, for the estimates of resources.
    """

    name: str
    scenes: str
    seed: int
    clouds: tuple[str, ...]
    points: int
    settings: dict[str, Any]

    @property
    def has_truth(self) -> bool:
        """Whether decoded clouds are measured against the true surface as well."""
        return bool(self.settings["truth"] and self.settings["make"] != "cloud")


class Plan:
    """Everything that a checked configuration asks for; InputError names what does not exist."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.scenes = {
            name: _scenes(name, value, config) for name, value in _items(config, "scenes")
        }
        self.datasets = {
            name: self._dataset(name, value) for name, value in _items(config, "datasets")
        }
        self.codecs = {name: codecs.entry(name, value) for name, value in _items(config, "codecs")}

    @property
    def results(self) -> Path:
        """Folder of everything that is made."""
        return Path(self.config["results"])

    @cached_property
    def clouds(self) -> tuple[tuple[str, str], ...]:
        """Every (data set, cloud), in the order of the table."""
        return tuple((data.name, cloud) for data in self.datasets.values() for cloud in data.clouds)

    @cached_property
    def cells(self) -> tuple[tuple[str, str, str, str], ...]:
        """Every (data set, cloud, codec, rate), in the order of the table."""
        return tuple(
            (dataset, cloud, codec, rate)
            for dataset, cloud in self.clouds
            for codec, entry in self.codecs.items()
            for rate in entry["rates"]
        )

    def _dataset(self, name: str, value: Mapping[str, Any]) -> DataSetPlan:
        scenes = self.scenes.get(value["scenes"])
        if scenes is None:
            known = ", ".join(self.scenes)
            raise InputError(
                f"datasets.{name}.scenes: no scene set '{value['scenes']}' (known: {known})"
            )
        seed = value.get("seed", self.config["seed"])
        points = _points(f"datasets.{name}", value)
        return DataSetPlan(name, scenes.name, seed, scenes.chosen, points, dict(value))


def _items(config: Config, key: str) -> list[tuple[str, Any]]:
    return list(config[key].items())


def _scenes(name: str, value: Mapping[str, Any], config: Config) -> ScenePlan:
    options = {**value["options"]}
    seed = value.get("seed", config["seed"])
    try:
        scenes = open_scene_set(value["loader"], options, seed)
        known = scenes.names()
    except InputError as error:
        raise InputError(f"scenes.{name}: {error}") from error
    return ScenePlan(name, value["loader"], seed, options, scenes, _chosen(name, value, known))


_CAPTURED_POINTS = 1_500_000
"""Expected of clouds that others captured: most rooms of S3DIS have fewer."""


def _points(where: str, settings: Mapping[str, Any]) -> int:
    """Expected points of a cloud; InputError when the sensor, sweep or errors do not exist."""
    if settings["make"] != "scan":
        return int(settings["points"]) if settings["make"] == "sample" else _CAPTURED_POINTS
    try:
        open_error_model(settings["errors"], settings["error_options"])
        sensor, sweep = load_sensor(settings["sensor"]), open_sweep(settings["sweep"])
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    return sweep.frames * sweep.steps(sensor) * sensor.lasers


def _chosen(name: str, value: Mapping[str, Any], known: list[str]) -> tuple[str, ...]:
    wanted = value.get("select", known)
    missing = [scene for scene in wanted if scene not in known]
    if missing:
        raise InputError(f"scenes.{name}.select: no scene '{missing[0]}' among its {len(known)}")
    return tuple(wanted[: value.get("limit")])

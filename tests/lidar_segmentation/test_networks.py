"""Networks are opened from files, and predict a class for each point of any scan."""

from __future__ import annotations

import json
import platform
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import load, save

from lidar_segmentation import SegmentationNetwork, class_map, open_network, shipped
from pointkit.errors import InputError
from tests.lidar_segmentation.toy import SETTINGS, scan
from tests.support.processors import printed_on_processors

pytestmark = pytest.mark.usefixtures("one_thread")

SHIPPED = ("rooms", "streets")
MOST_BYTES = 1_500_000


def street(seed: int = 0) -> np.ndarray:
    """A road between two walls, with boxes on it, as a sensor at 1.8 m sees them."""
    rng = np.random.default_rng(seed)
    road = rng.uniform([-6, -40, -1.85], [6, 40, -1.75], (6000, 3))
    walls = rng.uniform([8, -40, -1.8], [8.1, 40, 6], (6000, 3)) * rng.choice([-1, 1], (6000, 1))
    boxes = rng.uniform([2, -0.9, -1.8], [3.8, 0.9, -0.3], (2000, 3))
    boxes[:, 1] += 10.0 * rng.integers(-3, 4, 2000)
    walls[:, 2] = np.abs(walls[:, 2]) - 1.8
    return np.concatenate([road, walls, boxes])


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("weights") / "toy.safetensors"
    SETTINGS.export(path, SETTINGS.module(), {})
    return path


@pytest.fixture(scope="module")
def network(file: Path) -> SegmentationNetwork:
    return open_network(file)


def test_what_is_shipped_is_small_and_has_a_card() -> None:
    assert tuple(shipped()) == SHIPPED
    for name, path in shipped().items():
        assert path.stat().st_size <= MOST_BYTES
        network = open_network(name)
        assert network.classes == class_map(name).classes
        assert network.card["labels"] == name
        assert json.loads(path.with_suffix(".json").read_text()) == network.card


@pytest.mark.parametrize("name", SHIPPED)
def test_predictions_depend_on_neither_order_nor_threads_nor_precision(name: str) -> None:
    network, points = open_network(name), street()
    predicted = network.predict(points)
    order = np.random.default_rng(1).permutation(len(points))
    assert (network.predict(points[order]) == predicted[order]).mean() > 0.9999
    torch.set_num_threads(2)
    assert (network.predict(points) == predicted).mean() > 0.9999
    torch.set_num_threads(1)
    network.module.double()
    assert (network.predict(points) == predicted).mean() > 0.9999


_PREDICT = """
from lidar_segmentation import open_network
from tests.lidar_segmentation.test_networks import SHIPPED, street
for name in SHIPPED:
    print(open_network(name).predict(street()).tobytes().hex())
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="names instructions of x86-64")
def test_predictions_do_not_depend_on_the_instructions_of_libraries() -> None:
    first, *others = (
        np.frombuffer(bytes.fromhex(line), np.uint8)
        for line in ("".join(printed.split()) for printed in printed_on_processors(_PREDICT))
    )
    assert len(first) == len(SHIPPED) * len(street())
    for other in others:
        assert (other == first).mean() > 0.9999


def test_a_road_between_walls_is_a_road_between_buildings() -> None:
    network, points = open_network("streets"), street()
    names = np.array(network.classes)[network.predict(points)]
    assert (names[:6000] == "road").mean() > 0.6
    assert np.isin(names[6000:12000], ["building", "fence"]).mean() > 0.8


def test_every_point_of_any_scan_gets_a_class(network: SegmentationNetwork) -> None:
    assert network.predict(np.empty((0, 3))).shape == (0,)
    for points in (np.zeros((1, 3)), np.full((3, 3), 1e6), scan(1).xyz, np.zeros((2, 3), int)):
        predicted = network.predict(points)
        assert predicted.dtype == np.uint8
        assert predicted.shape == (len(points),)
        assert (predicted < len(network.classes)).all()


def test_a_network_is_named_by_a_digest_of_its_file(file: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.safetensors"
    SETTINGS.replaced(seed=2).export(other, SETTINGS.replaced(seed=2).module(), {})
    assert open_network(file).digest == open_network(str(file)).digest != open_network(other).digest


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros(3), "the scan is an array (3,), but must be numbers (n, 3)"),
        (np.zeros((2, 4)), "the scan is an array (2, 4), but must be numbers (n, 3)"),
        (np.array([[0, 0, np.nan]]), "the scan has points that are not finite"),
        (np.array([["a", "b", "c"]]), "the scan is an array (1, 3), but must be numbers (n, 3)"),
    ],
)
def test_what_is_no_scan_ends_in_one_line(
    network: SegmentationNetwork, points: np.ndarray, message: str
) -> None:
    with pytest.raises(InputError) as error:
        network.predict(points)
    assert str(error.value) == message


def changed(file: Path, folder: Path, header: dict[str, object], **arrays: np.ndarray) -> Path:
    """A file of weights with other entries of its header, and other arrays."""
    data = file.read_bytes()
    length = int.from_bytes(data[:8], "little")
    about = json.loads(json.loads(data[8 : 8 + length])["__metadata__"]["puckbench"]) | header
    path = folder / "changed.safetensors"
    path.write_bytes(save({**load(data), **arrays}, {"puckbench": json.dumps(about)}))
    return path


def test_other_and_damaged_weights_end_in_one_line(file: Path, tmp_path: Path) -> None:
    def refused(where: str | Path) -> str:
        with pytest.raises(InputError) as error:
            open_network(where)
        return str(error.value).removeprefix(f"{where}: ")

    assert refused("street").startswith("no such file of weights, nor shipped (known: rooms, st")
    broken = tmp_path / "broken.safetensors"
    broken.write_bytes(file.read_bytes()[:-7])
    assert refused(broken) == "damaged weights, or not a set of weights"
    flipped = bytearray(file.read_bytes())
    flipped[-1] ^= 1
    broken.write_bytes(flipped)
    assert refused(broken) == "damaged weights (check sum)"
    other = changed(file, tmp_path, {"network": "pcgcv2"})
    assert refused(other) == "weights of another network (pcgcv2)"
    about = {"cell_m": 0.4, "classes": ["a", "b"]}
    assert refused(changed(file, tmp_path, {"shape": about})) == "weights of another network"
    about = {"cells": 7, "classes": ["a", "b"]}
    line = refused(changed(file, tmp_path, {"shape": about}))
    assert line.startswith("shape: cells is 7, but must be")
    bias = load(file.read_bytes())["points.4.bias"]
    bias[0] = np.nan
    assert refused(changed(file, tmp_path, {}, **{"points.4.bias": bias})) == (
        "damaged weights (check sum)"
    )

"""`puckbench train` for every codec that learns: settings, checkpoints, cards, validation."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from cloud_files.clouds import write_cloud
from pcc_networks.catalogue import header_of
from pcc_networks.pcgcv2.weights import load_weights
from pcc_networks.weights_file import read_weights
from pointkit.errors import InputError
from pointkit.files import read_json
from pointkit.geometry.cloud import PointCloud
from pointkit.registry import trust
from puckbench.cli import main
from puckbench.codecs.registry import open_codec, open_training
from puckbench.steps.validation import faults, peak_of, validation
from tests.support.learned_codecs import LMBDAS

SMALL: dict[str, dict[str, Any]] = {
    "pcgcv1_plus": {"cube_size": 32, "batch_size": 1, "channels": [4, 8, 8], "lmbdas": [10, 2]},
    "pcgcv2_plus": {"cube_size": 32, "batch_size": 1, "channels": [4, 8, 8, 8], "lmbdas": [4, 1]},
    "sparse_octree_net": {"cube_size": 32, "batch_size": 1, "channels": 8},
}
TRAINED = {
    "pcgcv1_plus": [f"r{number}" for number in range(1, 7)],
    "pcgcv2_plus": [f"r{number}" for number in range(1, 7)],
    "sparse_octree_net": [f"r{number}" for number in range(1, 9)],
}
pytestmark = pytest.mark.usefixtures("one_thread")


def _plane() -> np.ndarray:
    grid = np.stack(np.meshgrid(np.arange(60.0), np.arange(60.0), indexing="ij"), axis=-1)
    return np.column_stack([grid.reshape(-1, 2), grid.reshape(-1, 2).sum(axis=1) // 2])


@pytest.fixture
def cloud(tmp_path: Path) -> Path:
    write_cloud(tmp_path / "a.ply", PointCloud(_plane()))
    return tmp_path / "a.ply"


def _train(cloud: Path, codec: str, steps: int, *more: str) -> int:
    words = [
        "train",
        str(cloud),
        "--out",
        str(cloud.with_name("set.safetensors")),
        "--codec",
        codec,
    ]
    return main([*words, "--steps", str(steps), "--options", json.dumps(SMALL[codec]), *more])


@pytest.mark.parametrize("codec", SMALL)
def test_clouds_in_metres_are_no_training_data(
    codec: str, cloud: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    metric = cloud.with_name("metric.ply")
    write_cloud(metric, PointCloud(_plane() / 100, about={"size": 0}))
    assert _train(metric, codec, 2) == 2
    messages = capsys.readouterr().err.splitlines()[-1]
    assert "metric.ply: the cloud is in metres: prepare it first (puckbench prepare)" in messages
    write_cloud(metric, PointCloud(_plane() / 100), describe=False)
    metric.with_suffix(".json").unlink(missing_ok=True)
    assert _train(metric, codec, 2) == 2
    assert "puckbench prepare" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("codec", SMALL)
def test_a_set_is_trained_resumed_exported_and_measured(codec: str, cloud: Path) -> None:
    write_cloud(cloud.with_name("held_out.ply"), PointCloud(_plane()[:1200]))
    assert _train(cloud, codec, 2, "--validate", str(cloud.with_name("held_out.ply"))) == 0
    card = read_json(cloud.with_name("set.json"))
    assert header_of(cloud.with_name("set.safetensors")).card == card
    assert (card["steps"], card["data"], card["codec"]) == (2, ["a.ply"], codec)
    assert card["validation"]["data"] == ["held_out.ply"]
    rows = cloud.with_name("set.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["step", "1", "2"]
    assert list(card["validation"]["rates"]) == TRAINED[codec]
    assert _train(cloud, codec, 3) == 2


def test_an_ended_training_is_exported_again_as_it_was(
    cloud: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _train(cloud, "pcgcv2_plus", 3) == 0
    assert "going on" not in capsys.readouterr().err
    first = cloud.with_name("set.safetensors").read_bytes()
    assert load_weights(cloud.with_name("set.safetensors")).lmbdas == LMBDAS
    assert _train(cloud, "pcgcv2_plus", 3) == 0
    assert "set.pt: going on after step 3\n" in capsys.readouterr().err
    assert cloud.with_name("set.safetensors").read_bytes() == first


def test_other_data_are_another_training_that_a_run_with_its_code_begins_anew(cloud: Path) -> None:
    assert _train(cloud, "pcgcv2_plus", 2, "--code", "a") == 0
    first = cloud.with_name("set.safetensors").read_bytes()
    write_cloud(cloud, PointCloud(_plane()[:3000]))
    assert _train(cloud, "pcgcv2_plus", 2) == 2
    assert _train(cloud, "pcgcv2_plus", 2, "--code", "a") == 0
    assert cloud.with_name("set.safetensors").read_bytes() != first
    rows = cloud.with_name("set.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["step", "1", "2"]


@pytest.mark.parametrize("codec", SMALL)
def test_a_training_may_start_from_a_set(codec: str, cloud: Path) -> None:
    assert _train(cloud, codec, 1) == 0
    first = cloud.with_name("first.safetensors")
    cloud.with_name("set.safetensors").rename(first)
    cloud.with_name("set.pt").unlink()
    training = open_training(codec, None, SMALL[codec])
    with training.trainer() as trainer:
        training.begin(trainer.model, first)
        training.export(cloud.with_name("again.safetensors"), trainer.model, {})
    kept = [read_weights(path).state for path in (first, cloud.with_name("again.safetensors"))]
    assert all(torch.equal(kept[1][name], value) for name, value in kept[0].items())
    assert _train(cloud, codec, 1, "--start", str(first)) == 0
    assert read_json(cloud.with_name("set.json"))["start"] == "first"


def test_measuring_on_the_way_changes_nothing(
    cloud: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _train(cloud, "pcgcv2_plus", 2) == 0
    state = load_weights(cloud.with_name("set.safetensors")).model.state_dict()
    cloud.with_name("set.pt").unlink()
    assert _train(cloud, "pcgcv2_plus", 2, "--validate", str(cloud), "--validate-every", "1") == 0
    messages = capsys.readouterr().err
    assert "step 1, r4: bpp" in messages
    assert "no d1_psnr without --peak" in messages
    assert "d1_psnr" not in read_json(cloud.with_name("set.json"))["validation"]["rates"]["r1"]
    again = load_weights(cloud.with_name("set.safetensors")).model.state_dict()
    assert all(torch.equal(again[name], value) for name, value in state.items())
    assert not list(cloud.parent.glob(".*"))


def _rates(*rows: tuple[float, float]) -> dict[str, dict[str, float]]:
    return {f"r{i}": {"bpp": b, "d1_mse": d, "cd_point": d} for i, (b, d) in enumerate(rows, 1)}


def test_rates_that_are_not_monotone_are_named() -> None:
    assert faults(_rates((0.1, 3.0), (0.2, 2.0), (0.3, 0.0), (0.4, 0.0))) == []
    assert faults(_rates((0.1, 3.0), (0.1, 2.0))) == ["bpp does not grow from r1 to r2"]
    assert faults(_rates((0.1, 2.0), (0.2, 3.0), (0.3, 1.0))) == [
        "d1_mse does not fall from r1 to r2",
        "cd_point does not fall from r1 to r2",
    ]


@pytest.mark.parametrize(
    ("codec", "settings", "fault"),
    [
        ("draco", {}, "codec draco: there is nothing to train"),
        ("pcgcv2_plus", {"step": 5}, r"unknown option .*step.* .*did you mean 'steps'"),
        ("pcgcv2_plus", {"steps": 0}, "steps is 0, but must be greater than 0"),
        ("pcgcv2_plus", {"channels": [4, 8]}, r"channels\.2.* is missing"),
        ("pcgcv2_plus", {"channels": [4, 8, 8, 6]}, r"channels\.3 is 6, .* multiple of 4"),
        ("pcgcv2_plus", {"lmbdas": []}, r"lmbdas is \(\), but must have at least 1"),
        ("pcgcv1_plus", {"cube_size": 20}, "cube_size is 20, but must be a multiple of 8"),
        ("sparse_octree_net", {"scales": [0.5, float("inf")]}, r"scales\.1 is inf, .* finite"),
    ],
)
def test_settings_that_cannot_be_are_refused(codec: str, settings: dict, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        open_training(codec, None, settings)


@pytest.mark.parametrize("content", [b"", b"no checkpoint"])
def test_other_files_are_no_checkpoints(content: bytes, cloud: Path) -> None:
    cloud.with_name("set.pt").write_bytes(content)
    assert _train(cloud, "pcgcv2_plus", 2) == 2


def test_a_training_of_ones_own_is_named_in_the_codecs_entry(cloud: Path) -> None:
    (cloud.parent / "mine.py").write_text(
        "from pcc_networks.training.settings import Pcgcv2Training\n"
        "class Mine(Pcgcv2Training):\n    pass\n"
    )
    entry = {"training": f"{cloud.parent}/mine.py:Mine"}
    trust(entry.values())
    assert type(open_training("draco", entry, {"steps": 7})).__name__ == "Mine"


def _of_size(size: int | None) -> PointCloud:
    return PointCloud(_plane(), about={} if size is None else {"size": size})


@pytest.mark.parametrize(
    ("sizes", "peak"), [([512, 512], 511), ([512, 1024], None), ([512, None], None), ([None], None)]
)
def test_the_peak_of_psnrs_is_that_of_all_clouds(
    sizes: list[int | None], peak: float | None
) -> None:
    assert peak_of([_of_size(size) for size in sizes]) == peak


def test_a_psnr_without_a_peak_is_left_out() -> None:
    draco, clouds = open_codec("draco"), [_of_size(512)]
    with_peak, without = (validation(draco, clouds, peak)["rates"]["r1"] for peak in (511.0, None))
    expected = 10 * np.log10(3 * 511**2 / without["d1_mse"])
    assert with_peak == {**without, "d1_psnr": pytest.approx(expected)}

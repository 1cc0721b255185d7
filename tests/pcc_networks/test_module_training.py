"""A module of one's own is trained, resumed, written and read."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from pydantic import PositiveInt

from pcc_networks.catalogue import header_of
from pcc_networks.training import ModuleTraining, train
from pcc_networks.training.settings import OctreeNetTraining
from pointkit.errors import InputError

pytestmark = pytest.mark.usefixtures("one_thread")


class Centre(torch.nn.Module):
    """Learns the mean of all voxels; half of the numbers only shows that it has a size."""

    def __init__(self, spare: int) -> None:
        super().__init__()
        self.mean = torch.nn.Parameter(torch.zeros(3))
        self.spare = torch.nn.Parameter(torch.randn(spare))

    def loss(self, cubes: list[np.ndarray]) -> torch.Tensor:
        voxels = torch.as_tensor(np.concatenate(cubes), dtype=self.mean.dtype)
        return ((voxels - self.mean) ** 2).mean() + 0 * self.spare.sum()


class CentreTraining(ModuleTraining):
    network = "centre"

    spare: PositiveInt = 2

    def module(self) -> Centre:
        return Centre(self.spare)


def cube(side: int) -> np.ndarray:
    return np.stack(np.meshgrid(*[np.arange(float(side))] * 3), axis=-1).reshape(-1, 3)


def trained(folder: Path, settings: ModuleTraining, steps: int | None = None) -> Any:
    """The trainer after its steps, or after an interruption."""
    examples = settings.examples([cube(20)])
    with settings.trainer() as trainer:

        def report(step: int, loss: float) -> None:
            trainer.curve.append({"step": step, **trainer.row(loss)})
            if step == steps:
                raise KeyboardInterrupt

        with suppress(KeyboardInterrupt):
            train(trainer, examples.batch, folder / "a.pt", every=5, report=report)
        return trainer


SETTINGS = {"cube_size": 20, "batch_size": 1, "steps": 60, "learning_rate": 1.0, "device": "cpu"}


def test_the_loss_falls_to_the_variance_of_the_voxels(tmp_path: Path) -> None:
    trainer = trained(tmp_path, CentreTraining(**{**SETTINGS, "steps": 400}))
    losses = [row["loss"] for row in trainer.curve]
    # each cube is cut around one of the voxels: means differ from cube to cube
    assert losses[0] > 2 * np.mean(losses[-50:])
    assert list(trainer.curve[0]) == ["step", "loss"]


def test_a_resumed_training_equals_an_uninterrupted_one(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    whole = trained(tmp_path, CentreTraining(**SETTINGS))
    half = trained(tmp_path / "other", CentreTraining(**SETTINGS), steps=32)
    assert half.done == 32
    resumed = trained(tmp_path / "other", CentreTraining(**{**SETTINGS, "device": None}))
    assert len(resumed.curve) == 60
    assert resumed.curve == whole.curve
    assert torch.equal(resumed.model.mean, whole.model.mean)


def test_a_file_has_the_sizes_of_its_module(tmp_path: Path) -> None:
    settings = CentreTraining(**SETTINGS, spare=5)
    model = settings.module()
    settings.export(tmp_path / "a.safetensors", model, {"data": ["a"]})
    assert header_of(tmp_path / "a.safetensors").shape == {"spare": 5}
    weights = CentreTraining.load(tmp_path / "a.safetensors")
    assert torch.equal(weights.model.spare, model.spare.detach().half().float())
    assert (len(weights.digest), weights.card) == (8, {"data": ["a"]})
    assert not weights.model.training


def test_voxels_are_those_of_the_grid_and_the_smallest_number_is_in_proportion() -> None:
    settings = CentreTraining(**{**SETTINGS, "cube_size": 8}, voxel_size=2.0)
    (keys,) = settings.examples([cube(20)]).batch(0)
    assert 0 < len(keys) <= 8**3
    assert settings.min_voxels == 200 * 8**2 // 64**2
    assert OctreeNetTraining().min_voxels == 200


def test_weights_of_another_network_are_refused(tmp_path: Path) -> None:
    class Other(CentreTraining):
        def module(self) -> Any:
            return torch.nn.Linear(2, self.spare)

    Other(**SETTINGS).export(tmp_path / "a.safetensors", Other(**SETTINGS).module(), {})
    with pytest.raises(InputError, match=r"a.safetensors: weights of another network"):
        CentreTraining.load(tmp_path / "a.safetensors")


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device here")
def test_a_missing_device_is_named(tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match="device cuda: PyTorch finds no CUDA device here"),
        CentreTraining(**{**SETTINGS, "device": "cuda"}).trainer(),
    ):
        pass

"""Training examples that are cut from clouds, and the loop that trains a model on them."""

from __future__ import annotations

import io
import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pcc_networks.sparse.voxels import Keys, morton_keys, morton_voxels
from pcc_networks.weights_file import DeviceName, placed, read_checkpoint
from pointkit.errors import InputError
from pointkit.files import write_bytes
from pointkit.seeding import generator

_ATTEMPTS = 50
Voxels = NDArray[np.integer[Any]]


@dataclass(frozen=True)
class CubeExamples:
    """Random cubes that are cut from voxelised clouds, as examples for training.

    The seed and the number of a step determine the cubes of this step.

    Parameters
    ----------
    clouds
        Voxels of each cloud: integers (n, 3).
    cube_size
        Number of voxels along an edge of a cube.
    batch_size
        Number of cubes in a batch.
    min_voxels
        Minimum number of occupied voxels in a cube.
    min_kept_fraction
        Each cube keeps a random fraction of its voxels, between this number and 1, so that training
        includes sparser clouds.
    seed
        Seed of all random choices.
    """

    clouds: Sequence[NDArray[Any]]
    cube_size: int = 64
    batch_size: int = 4
    min_voxels: int = 200
    min_kept_fraction: float = 1.0
    seed: int = 1
    kind: ClassVar[str] = "training cubes"  # name of the stream of random numbers

    def batch(self, step: int) -> list[Keys]:
        """Return the cubes for a step of the training, mirrored and rotated at random.

        Parameters
        ----------
        step
            Number of the step.

        Returns
        -------
        list of ndarray
            For each cube, the sorted Morton keys (n,) of its voxels.

        Raises
        ------
        InputError
            If no cube with enough voxels is found.
        """
        rng = generator(self.seed, self.kind, str(step))
        return [self._cube(rng) for _ in range(self.batch_size)]

    def _cube(self, rng: np.random.Generator) -> Keys:
        for _ in range(_ATTEMPTS):
            keys = self._crop(self.clouds[int(rng.integers(len(self.clouds)))], rng)
            if keys is not None:
                return keys
        raise InputError(
            f"no cube of {self.cube_size} voxels' side holds {self.min_voxels} voxels: give denser "
            "clouds, scale those in metres (puckbench prepare), or give options with coarser grids "
            '("mean_occupied_children": [2], where the codec has it) or larger cubes '
            '("cube_size": 256)'
        )

    def _crop(self, voxels: NDArray[Any], rng: np.random.Generator) -> Keys | None:
        size = self.cube_size
        centre = voxels[rng.integers(len(voxels))]
        corner = centre - rng.integers(0, size, 3)
        inside = voxels[((voxels >= corner) & (voxels < corner + size)).all(axis=1)] - corner
        inside = inside[rng.random(len(inside)) < self.min_kept_fraction ** rng.random()]
        if len(inside) < self.min_voxels:
            return None
        return np.unique(morton_keys(random_symmetry(inside, size, rng)))


def random_symmetry(
    voxels: Voxels, size: int, rng: np.random.Generator, upright: bool = False
) -> Voxels:
    """Mirror and rotate the voxels of a cube at random.

    Parameters
    ----------
    voxels
        Voxels (n, 3) with coordinates in [0, size).
    size
        Number of voxels along an edge of the cube.
    rng
        Source of random numbers.
    upright
        Whether to choose only among the 8 symmetries that keep the z axis, instead of all 48.

    Returns
    -------
    ndarray
        The transformed voxels (n, 3).
    """
    axes = 2 if upright else 3
    symmetric = voxels.copy()
    mirrored = np.where(
        rng.integers(0, 2, axes) == 1, size - 1 - voxels[:, :axes], voxels[:, :axes]
    )
    symmetric[:, :axes] = mirrored[:, rng.permutation(axes)]
    return symmetric


def join_clouds(clouds: Sequence[Keys]) -> Keys:
    """Place clouds side by side, so that no two touch, and return all their Morton keys (n,).

    Raises InputError if the clouds are too large for one set of keys.
    """
    bits = max(int(keys[-1]).bit_length() for keys in clouds)
    cell = 3 * (-(-bits // 3) + 1)  # twice the side, which leaves a gap
    if cell + (len(clouds) - 1).bit_length() > 60:
        raise InputError("the training clouds are too large for one batch")
    return np.concatenate([keys | i << cell for i, keys in enumerate(clouds)])


M = TypeVar("M", bound=nn.Module)
L = TypeVar("L")


class TrainingSettings(Protocol):
    """What a trainer needs of the settings of a training, such as `BaseTraining`."""

    @property
    def steps(self) -> int:
        """Number of steps of the optimiser."""

    @property
    def learning_rate(self) -> float:
        """Learning rate at the start of the cosine schedule."""

    @property
    def final_learning_rate(self) -> float:
        """Learning rate at its end."""

    @property
    def seed(self) -> int:
        """Seed of the noise."""

    def model_dump(self) -> dict[str, Any]:
        """Return all settings, which a checkpoint must share."""


class OtherTrainingError(InputError):
    """Raised if a checkpoint belongs to a training with other settings, data or network."""


class BaseTrainer(ABC, Generic[M, L]):
    """Base class of trainers, which hold a model in training and the state of its optimiser (Adam).

    A subclass defines `step` and `row`.

    Parameters
    ----------
    model
        The network, whose parameters the training changes in place.
    training
        Settings of the training.
    groups
        Parameter groups for the optimiser, each with ``params`` and the factor ``lr_factor`` by
        which the learning rate is multiplied. By default, all parameters are one group.

    Attributes
    ----------
    done
        Number of completed steps.
    identity
        Properties, such as the data, that a checkpoint must share so that it can be resumed.
    curve
        A row for each completed step, filled by the caller.
    """

    max_gradient_norm: float | None = None
    """Norm to which gradients are clipped."""

    def __init__(
        self, model: M, training: TrainingSettings, groups: Sequence[Mapping[str, Any]] = ()
    ) -> None:
        self.model = model
        self.training = training
        self.done = 0
        self.identity: dict[str, Any] = {}
        self.curve: list[dict[str, float]] = []
        every = [{"params": list(model.parameters()), "lr_factor": 1.0}]
        self.optimiser = torch.optim.Adam([dict(group) for group in groups or every])
        self.noise = torch.Generator().manual_seed(training.seed)

    @abstractmethod
    def step(self, batch: Any) -> L:
        """Do one step of the optimiser on a batch, and return the loss.

        Parameters
        ----------
        batch
            Examples, for codecs the Morton keys (n,) of the voxels of each.
        """

    @abstractmethod
    def row(self, loss: L) -> dict[str, float]:
        """Return the loss of a step as a row of the training curve: values by column name.

        The first column is the value that the training minimises.
        """

    def optimiser_step(self, loss: Tensor) -> None:
        """Update the parameters by the gradients of a loss, and count the step."""
        for group in self.optimiser.param_groups:
            group["lr"] = self._learning_rate() * group.get("lr_factor", 1.0)
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        if self.max_gradient_norm is not None:
            torch.nn.utils.clip_grad_norm_(self.model.parameters(), self.max_gradient_norm)
        self.optimiser.step()
        self.done += 1

    def _learning_rate(self) -> float:
        first, last = self.training.learning_rate, self.training.final_learning_rate
        cosine = math.cos(math.pi * self.done / max(self.training.steps, 1))
        return last + (first - last) * (1 + cosine) / 2

    def save(self, path: Path) -> None:
        """Write the model, the optimiser and the random generator's state to a checkpoint file."""
        state = {
            "model": self.model.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "noise": self.noise.get_state(),
            "done": self.done,
            "training": _as_json(self.training.model_dump()),
            "identity": _as_json(self.identity),
            "curve": self.curve,
        }
        content = io.BytesIO()  # PyTorch's writer gives no useful message for a full disk
        torch.save(state, content)
        write_bytes(path, content.getvalue())

    def resume(self, path: Path) -> None:
        """Continue from a checkpoint file that `save` wrote.

        Raises
        ------
        OtherTrainingError
            If the checkpoint is of another network, or its settings or `identity` differ.
        InputError
            If the file is not a checkpoint.
        """
        state = read_checkpoint(path, "not a checkpoint of a training")
        for name, expected in (
            ("training", self.training.model_dump()),
            ("identity", self.identity),
        ):
            saved = _as_json(state.get(name, {}))
            if any(saved.get(key, value) != value for key, value in _as_json(expected).items()):
                raise OtherTrainingError(f"{path}: the saved training has other settings or data")
        try:
            self.model.load_state_dict(state["model"])
            self.optimiser.load_state_dict(state["optimiser"])
            self.noise.set_state(state.get("noise", self.noise.get_state()))
            self.done = int(state["done"])
        except (KeyError, RuntimeError, TypeError, ValueError) as error:
            raise OtherTrainingError(f"{path}: not a checkpoint of this network") from error
        self.curve = state.get("curve", [])


def _as_json(settings: Mapping[str, Any]) -> dict[str, Any]:
    converted: dict[str, Any] = json.loads(json.dumps(settings))
    return converted


class ModuleTrainer(BaseTrainer[Any, float]):
    """Trains a module that computes its loss itself (`ModuleTraining.module`)."""

    def step(self, clouds: Sequence[Keys]) -> float:
        """Do one step of the optimiser on a batch, and return the loss."""
        loss = self.model.loss([morton_voxels(keys) for keys in clouds])
        self.optimiser_step(loss)
        return float(loss.detach())

    def row(self, loss: float) -> dict[str, float]:
        """Return the loss of a step as a row of the training curve."""
        return {"loss": loss}


def on_device(model: M, device: DeviceName | None = None) -> M:
    """Move a model to a device: by default CUDA if PyTorch finds a device, else the CPU."""
    return placed(model, device or ("cuda" if torch.cuda.is_available() else "cpu"))


def _ignore(_step: int, _loss: object) -> None:
    pass


def train(
    trainer: BaseTrainer[M, L],
    batches: Callable[[int], Any],
    checkpoint: Path,
    every: int = 500,
    report: Callable[[int, L], None] = _ignore,
) -> None:
    """Train a model to the last step of its settings, and write checkpoints on the way.

    Parameters
    ----------
    trainer
        The model with its optimiser, opened by the method `trainer` of the settings. If the file
        `checkpoint` exists, the training continues from it.
    batches
        Function that returns the batch of a step, as the trainer's `step` takes it. The batch must
        depend only on the number of the step, so that a resumed training equals an uninterrupted
        one.
    checkpoint
        File that is written every `every` steps and at the end.
    every
        Number of steps between checkpoints.
    report
        Function that is called after each step, with the number of completed steps and the loss of
        the step.

    Raises
    ------
    OtherTrainingError
        If the checkpoint is of a training with other settings or data.
    """
    if checkpoint.exists():
        trainer.resume(checkpoint)
    while trainer.done < trainer.training.steps:
        loss = trainer.step(batches(trainer.done))
        report(trainer.done, loss)
        if trainer.done % every == 0 or trainer.done == trainer.training.steps:
            trainer.save(checkpoint)

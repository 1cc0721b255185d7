"""Training of a PyTorch module of one's own, which computes its loss itself."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import PositiveFloat

from pcc_networks.training.settings import BaseTraining
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.models import parsed

if TYPE_CHECKING:
    from pcc_networks.training.loop import CubeExamples, ModuleTrainer


class TrainedModule(NamedTuple):
    """A module that `ModuleTraining.load` read from a file of weights.

    Parameters
    ----------
    model
        The module, without gradients.
    digest
        8 bytes by which streams name the weights.
    card
        Model card, such as the training data.
    """

    model: Any
    digest: bytes
    card: Mapping[str, Any]


class ModuleTraining(BaseTraining):
    """Base class of trainings of a PyTorch module that computes its loss itself.

    A subclass defines `module`, and sets `network`, by which files of weights are recognised. The
    fields that it adds are the sizes of the module: they are stored with the weights, so that
    `load` can make the module again.

    Parameters
    ----------
    voxel_size
        Side of a voxel, in the unit of the clouds.
    """

    network: ClassVar[str]

    voxel_size: PositiveFloat = 1.0

    @abstractmethod
    def module(self) -> Any:
        """Return a new module.

        Its method ``loss`` takes the batch of a step, a list with an integer array (n, 3) of the
        distinct voxels of each cube, from 0 to `cube_size` - 1. It returns the value to minimise, a
        tensor with one number, such as bits per voxel. Parameters and buffers are numbers that half
        precision can store.
        """

    @contextmanager
    def trainer(self) -> Iterator[ModuleTrainer]:
        import torch

        from pcc_networks.training.loop import ModuleTrainer, on_device

        torch.manual_seed(self.seed)
        yield ModuleTrainer(on_device(self.module(), self.device), self)

    def examples(self, clouds: Sequence[Floats]) -> CubeExamples:
        """Return training examples: random cubes of clouds on the grid of `voxel_size`."""
        from pcc_networks.training.loop import CubeExamples

        voxels = [np.rint(cloud / self.voxel_size).astype(np.int64) for cloud in clouds]
        return CubeExamples(
            voxels, self.cube_size, self.batch_size, self.min_voxels, seed=self.seed
        )

    def export(self, path: Path, model: Any, card: Mapping[str, Any]) -> None:
        """Write a trained module and its sizes to a file that `load` reads."""
        from pcc_networks.weights_file import write_weights

        sizes = self.model_dump(exclude=set(ModuleTraining.model_fields))
        header = {"network": self.network, "shape": sizes, "lmbdas": (), "card": dict(card)}
        write_weights(path, header, model.state_dict())

    @classmethod
    def load(cls, path: Path, device: Literal["cpu", "cuda"] = "cpu") -> TrainedModule:
        """Read a trained module from a file that `export` wrote.

        Parameters
        ----------
        path
            The file.
        device
            Device on which the module runs.

        Raises
        ------
        InputError
            The file is damaged or of another network, or the device does not exist.
        """
        from pcc_networks.weights_file import placed, read_weights

        contents = read_weights(path)
        model = parsed(cls, contents.header.shape, f"{path}: sizes").module()
        try:
            model.load_state_dict(contents.state)
        except RuntimeError as error:
            raise InputError(f"{path}: weights of another network") from error
        model = placed(model.eval().requires_grad_(False), device)
        return TrainedModule(model, contents.digest, contents.header.card)

"""Settings of the training of each network, as pydantic models.

The fields of a subclass of `BaseTraining` are the options of a configuration file and of the
command ``puckbench train --options``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field, PositiveFloat, PositiveInt

from pcc_networks.catalogue import PCGCV1, PCGCV2, NetworkType
from pointkit.errors import InputError
from pointkit.models import Model

if TYPE_CHECKING:
    from pcc_networks.octree_net.training import OctreeExamples, OctreeNetTrainer
    from pcc_networks.pcgcv1.training import Pcgcv1Trainer
    from pcc_networks.pcgcv2.training import Pcgcv2Trainer
    from pcc_networks.training.loop import BaseTrainer, CubeExamples
    from pointkit.geometry.cloud import Floats

_MIN_VOXELS, _SIZE = 200, 64
"""Minimum voxels of a cube of side `_SIZE`; smaller cubes need fewer, in proportion to side**2."""

Rates = Mapping[str, Mapping[str, Any]]
Channels = Annotated[int, Field(gt=0, multiple_of=4)]
"""Channels of a residual block; each branch has a quarter of them."""


def _ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(sorted(set(values)))


Lmbdas = Annotated[tuple[PositiveFloat, ...], Field(min_length=1), AfterValidator(_ascending)]
"""Ascending Lagrangian weights without duplicates."""


class BaseTraining(Model, ABC):
    """Settings that all trainings share.

    Parameters
    ----------
    steps
        Number of steps of the optimiser.
    batch_size
        Number of cubes in a step.
    cube_size
        Number of voxels along an edge of a cube.
    learning_rate, final_learning_rate
        Learning rates at the start and at the end of a cosine schedule.
    seed
        Seed of the initial weights, of the choice of cubes, and of the noise that replaces
        rounding.
    device
        Device of the training; by default CUDA if PyTorch finds a device, else the CPU. Another
        device can continue the training.
    """

    steps: PositiveInt = 2000
    batch_size: PositiveInt = 4
    cube_size: PositiveInt = 64
    learning_rate: PositiveFloat = 1e-3
    final_learning_rate: PositiveFloat = 2e-5
    seed: Annotated[int, Field(ge=0)] = 1
    device: Annotated[Literal["cpu", "cuda"] | None, Field(exclude=True)] = None

    @property
    def min_voxels(self) -> int:
        """Minimum number of occupied voxels in a cube."""
        return max(1, _MIN_VOXELS * min(self.cube_size, _SIZE) ** 2 // _SIZE**2)

    @abstractmethod
    def trainer(self) -> AbstractContextManager[BaseTrainer[Any, Any]]:
        """Open a trainer of a new model, which is on the training's device."""

    @abstractmethod
    def examples(self, clouds: Sequence[Floats]) -> CubeExamples:
        """Return training examples: random cubes that are cut from clouds.

        Parameters
        ----------
        clouds
            Points (n, 3) of each cloud.
        """

    def begin(self, model: Any, weights: Path) -> None:
        """Copy weights from a file into a model, so that the training starts from them.

        Raises InputError if the weights have another shape.
        """
        from pcc_networks.weights_file import read_weights

        try:
            model.load_state_dict(self.parameters(read_weights(weights).state))
        except RuntimeError as error:
            raise InputError(f"{weights}: weights of another shape") from error

    def parameters(self, tensors: Mapping[str, Any]) -> Mapping[str, Any]:
        """Convert the tensors of a file of weights to parameters of a model."""
        return tensors

    @abstractmethod
    def export(self, path: Path, model: Any, card: Mapping[str, Any]) -> None:
        """Write a trained model to a file that `load_weights` of its network reads.

        Parameters
        ----------
        path
            File to write.
        model
            The trained model.
        card
            Model card, such as the training data, which is stored in the header of the file.
        """

    def rates(self, codec_rates: Rates) -> dict[str, Mapping[str, Any]]:
        """Return the rates of a codec that the trained weights support.

        Parameters
        ----------
        codec_rates
            Arguments of the codec for each rate, by the name of the rate.
        """
        return dict(codec_rates)


class MultiRateTraining(BaseTraining):
    """Settings of a training for several rates.

    Parameters
    ----------
    lmbdas
        Lagrangian weight of the distortion for each rate. A larger weight means more bits.
    channels
        Number of features at each stride of the network, multiples of four.
    min_kept_fraction
        Each cube keeps a random fraction of its voxels, at least this one, so that training
        includes sparser clouds.
    mean_occupied_children
        Densities, in occupied children per voxel. For each density, clouds are coarsened by the
        fewest whole octaves that reach the density.
    """

    network: ClassVar[NetworkType]

    lmbdas: Lmbdas = (0.25, 0.5, 1.0, 2.0, 4.0, 6.0, 10.0)
    channels: tuple[Channels, ...]
    min_kept_fraction: Annotated[float, Field(gt=0, le=1)] = 1.0
    mean_occupied_children: Annotated[tuple[PositiveFloat, ...], Field(min_length=1)] = (1.0,)

    def examples(self, clouds: Sequence[Floats]) -> CubeExamples:
        """Return training examples: random cubes of clouds on grids of the given densities."""
        from pcc_networks.grid_level import on_dense_grids
        from pcc_networks.training.loop import CubeExamples

        voxels = [v for cloud in clouds for v in on_dense_grids(cloud, self.mean_occupied_children)]
        return CubeExamples(
            voxels,
            self.cube_size,
            self.batch_size,
            self.min_voxels,
            self.min_kept_fraction,
            self.seed,
        )

    def export(self, path: Path, model: Any, card: Mapping[str, Any]) -> None:
        """Write a trained model with its Lagrangian weights to a file that `load_weights` reads."""
        from pcc_networks.weights_file import save_multi_rate

        save_multi_rate(path, self.network, model, self.lmbdas, card)

    def rates(self, codec_rates: Rates) -> dict[str, Mapping[str, Any]]:
        """Return the rates of a codec whose Lagrangian weight was trained.

        If there are none, one rate for each trained weight is returned instead.

        Parameters
        ----------
        codec_rates
            Arguments of the codec for each rate, by the name of the rate.
        """
        trained = {name: rate for name, rate in codec_rates.items() if rate["lmbda"] in self.lmbdas}
        return trained or {f"lmbda_{lmbda:g}": {"lmbda": lmbda} for lmbda in self.lmbdas}


class Pcgcv1Training(MultiRateTraining):
    """Settings for training PCGCv1.

    Cubes may be smaller than those of the codec, since the network is convolutional. The numbers in
    `channels` belong to strides 1, 2 and 4.

    Parameters
    ----------
    rate_warm_up
        Fraction of the steps during which the weight of the rate in the loss grows to 1. If it were
        1 from the start, the network would learn not to use its latent.
    """

    network = PCGCV1
    batch_size: PositiveInt = 2
    cube_size: Annotated[int, Field(gt=0, multiple_of=8)] = 64
    lmbdas: Lmbdas = (0.75, 2.0, 3.5, 6.0, 10.0)
    channels: tuple[Channels, Channels, Channels] = (16, 32, 64)
    rate_warm_up: PositiveFloat = 0.5

    @contextmanager
    def trainer(self) -> Iterator[Pcgcv1Trainer]:
        import torch

        from pcc_networks.gains import initialise_gains
        from pcc_networks.pcgcv1.model import PCGCv1, Pcgcv1Shape
        from pcc_networks.pcgcv1.training import Pcgcv1Trainer, initialise
        from pcc_networks.training.loop import on_device

        torch.manual_seed(self.seed)
        rates = len(self.lmbdas)
        model = PCGCv1(Pcgcv1Shape(channels=self.channels, rates=rates, occupied_blocks=True))
        initialise(model, self.cube_size)
        initialise_gains(model, self.lmbdas)
        yield Pcgcv1Trainer(on_device(model, self.device), self)


class Pcgcv2Training(MultiRateTraining):
    """Settings for training PCGCv2.

    The numbers in `channels` belong to strides 1, 2, 4 and 8.
    """

    network = PCGCV2
    channels: tuple[Channels, Channels, Channels, Channels] = (16, 32, 64, 32)

    @contextmanager
    def trainer(self) -> Iterator[Pcgcv2Trainer]:
        import torch

        from pcc_networks.gains import initialise_gains
        from pcc_networks.pcgcv2.model import PCGCv2, Pcgcv2Shape
        from pcc_networks.pcgcv2.training import Pcgcv2Trainer
        from pcc_networks.sparse.thread_pool import thread_pool
        from pcc_networks.training.loop import on_device

        torch.manual_seed(self.seed)
        model = PCGCv2(Pcgcv2Shape(channels=self.channels, rates=len(self.lmbdas)))
        initialise_gains(model, self.lmbdas)
        with thread_pool() as pool:
            yield Pcgcv2Trainer(on_device(model, self.device), self, pool)


class OctreeNetTraining(BaseTraining):
    """Settings for training the sparse octree net.

    Parameters
    ----------
    cube_size
        Number of voxels along an edge of a cube, which should be a power of two.
    scales
        Scales of the coarsest and of the finest grid from which cubes are cut.
    convolutions
        Number of convolutions before the first group of voxels of a level.
    symmetries
        From how many symmetries of a cube one is drawn for each example: all 48, or the 8 about the
        vertical axis.
    """

    steps: PositiveInt = 3000
    batch_size: PositiveInt = 2
    cube_size: PositiveInt = 128
    learning_rate: PositiveFloat = 3e-3
    scales: tuple[PositiveFloat, PositiveFloat] = (0.1, 1.1)
    channels: PositiveInt = 32
    convolutions: PositiveInt = 1
    symmetries: Literal[8, 48] = 48

    @contextmanager
    def trainer(self) -> Iterator[OctreeNetTrainer]:
        import torch

        from pcc_networks.octree_net.model import OctreeNet, OctreeNetShape
        from pcc_networks.octree_net.training import OctreeNetTrainer
        from pcc_networks.sparse.thread_pool import thread_pool
        from pcc_networks.training.loop import on_device

        torch.manual_seed(self.seed)
        model = OctreeNet(OctreeNetShape(channels=self.channels, convolutions=self.convolutions))
        with thread_pool() as pool:
            yield OctreeNetTrainer(on_device(model, self.device), self, pool)

    def examples(self, clouds: Sequence[Floats]) -> OctreeExamples:
        """Return training examples: random cubes of clouds on grids of random scales."""
        from pcc_networks.octree_net.training import OctreeExamples

        coarsest, finest = self.scales
        return OctreeExamples(
            clouds, self.cube_size, self.batch_size, seed=self.seed, coarsest=coarsest,
            finest=finest, upright=self.symmetries == 8,
        )  # fmt: skip

    def parameters(self, tensors: Mapping[str, Any]) -> Mapping[str, Any]:
        from pcc_networks.octree_net.weights import parameters

        return parameters(tensors)

    def export(self, path: Path, model: Any, card: Mapping[str, Any]) -> None:
        """Write a trained model to a file that `load_weights` reads."""
        from pcc_networks.octree_net.weights import save_weights

        save_weights(path, model, card)

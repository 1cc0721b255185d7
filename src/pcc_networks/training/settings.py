"""Training settings of learned codecs, as pydantic models.

The fields of a codec's subclass of `BaseTraining` are the options of a configuration and of
``puckbench train --options``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import AfterValidator, Field, PositiveFloat, PositiveInt

from pcc_networks.catalogue import NetworkType
from pointkit.errors import InputError
from pointkit.models import Model

if TYPE_CHECKING:
    from pcc_networks.training.examples import CubeExamples
    from pcc_networks.training.loop import BaseTrainer
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
    """Settings of every training.

    Parameters
    ----------
    batch_size
        Cubes per step.
    cube_size
        Voxels along an edge of a cube.
    learning_rate, final_learning_rate
        Learning rates at the start and the end of a cosine schedule.
    seed
        Seed of initial weights, cubes, and noise that replaces rounding.
    """

    steps: PositiveInt = 2000
    batch_size: PositiveInt = 4
    cube_size: PositiveInt = 64
    learning_rate: PositiveFloat = 1e-3
    final_learning_rate: PositiveFloat = 2e-5
    seed: Annotated[int, Field(ge=0)] = 1

    @abstractmethod
    def trainer(self) -> AbstractContextManager[BaseTrainer[Any, Any]]:
        """Open a trainer of a new model, on CUDA if available, otherwise on the CPU."""

    @abstractmethod
    def examples(self, clouds: Sequence[Floats]) -> CubeExamples: ...

    def begin(self, model: Any, weights: Path) -> None:
        from pcc_networks.weights_file import read_weights

        try:
            model.load_state_dict(self.parameters(read_weights(weights).state))
        except RuntimeError as error:
            raise InputError(f"{weights}: weights of another shape") from error

    def parameters(self, tensors: Mapping[str, Any]) -> Mapping[str, Any]:
        """Convert the tensors of a set of weights to the parameters of a model."""
        return tensors

    @abstractmethod
    def export(self, path: Path, model: Any, card: Mapping[str, Any]) -> None: ...

    def rates(self, codec_rates: Rates) -> dict[str, Mapping[str, Any]]:
        """Return those rates of the codec that the trained weights support."""
        return dict(codec_rates)


class MultiRateTraining(BaseTraining):
    """Settings of a training for several rates.

    Parameters
    ----------
    lmbdas
        Lagrangian weight of the distortion for each rate.
    min_kept_fraction
        Minimum fraction of voxels that a cube keeps, so that training includes sparser clouds.
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
        from pcc_networks.grid_level import on_dense_grids
        from pcc_networks.training.examples import CubeExamples

        voxels = [v for cloud in clouds for v in on_dense_grids(cloud, self.mean_occupied_children)]
        return CubeExamples(
            voxels,
            self.cube_size,
            self.batch_size,
            max(1, _MIN_VOXELS * min(self.cube_size, _SIZE) ** 2 // _SIZE**2),
            self.min_kept_fraction,
            self.seed,
        )

    def export(self, path: Path, model: Any, card: Mapping[str, Any]) -> None:
        from pcc_networks.weights_file import save_multi_rate

        save_multi_rate(path, self.network, model, self.lmbdas, card)

    def rates(self, codec_rates: Rates) -> dict[str, Mapping[str, Any]]:
        """Return the rates with a trained lambda; if there are none, a rate per trained lambda."""
        trained = {name: rate for name, rate in codec_rates.items() if rate["lmbda"] in self.lmbdas}
        return trained or {f"lmbda_{lmbda:g}": {"lmbda": lmbda} for lmbda in self.lmbdas}

"""How a network is trained: the settings of a run, which its codec's entry names a class of.

A network that is to be trained has a dataclass of its settings, derived from `Training`, and names
it in its codec's entry (`training`). Listing and checking settings loads no PyTorch.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.codecs.registry import training_class
from puckbench.core.errors import InputError
from puckbench.core.plugins import load_class

if TYPE_CHECKING:
    from puckbench.codecs.learned.training.examples import Examples
    from puckbench.codecs.learned.training.loop import Trainer
    from puckbench.geometry.cloud import Floats

_FEWEST, _SIDE = 200, 64
"""Voxels of a cube of a side worth learning from; in smaller cubes as many as their square has."""

Rates = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, kw_only=True)
class Training(ABC):
    """What a training run is.

    steps: on `cubes` cubes of `side` voxels each. rate_first, rate_last: step size at the start and
    at the end. seed: of the first weights, of the cubes and of the noise.
    """

    steps: int = 2000
    cubes: int = 4
    side: int = 64
    rate_first: float = 1e-3
    rate_last: float = 2e-5
    seed: int = 1

    def __post_init__(self) -> None:
        for field in fields(self):
            value, free = getattr(self, field.name), "..." in str(field.type)
            if not _fits(value, field.default, free, 0 if field.name == "seed" else None):
                raise InputError(f"training: {field.name} cannot be {value}")

    @abstractmethod
    def trainer(self) -> AbstractContextManager[Trainer[Any, Any]]:
        """A new model with its optimiser; on CUDA if there, else on the processor."""

    @abstractmethod
    def examples(self, clouds: Sequence[Floats]) -> Examples:
        """What the model learns from: batches of cubes of prepared clouds (n, 3)."""

    def begin(self, model: Any, weights: Path) -> None:
        """Give a new model the weights of a set; InputError when it has another shape."""
        from puckbench.codecs.learned.weights_file import read_weights

        try:
            model.load_state_dict(self.state(read_weights(weights).state))
        except RuntimeError as error:
            raise InputError(f"{weights}: weights of another shape") from error

    def state(self, kept: Mapping[str, Any]) -> Mapping[str, Any]:
        """Parameters from the tensors that a set keeps."""
        return kept

    @abstractmethod
    def export(self, path: Path, model: Any, card: Mapping[str, Any]) -> None:
        """Write the model as a set of weights with its card."""

    def rates(self, known: Rates) -> dict[str, Mapping[str, Any]]:
        """The rates at which the set will code, of those that the codec's entry has."""
        return dict(known)


@dataclass(frozen=True, kw_only=True)
class TrainingByAlpha(Training):
    """A training for several rates at once.

    alphas: weights of the distortion in the loss. widths: features of the network at its strides,
    multiples of four. thinnest: least share of its voxels that a cube keeps. children: of a voxel
    in the mean; clouds are learned from on each grid that is halved until it has so many.
    """

    alphas: tuple[float, ...] = (0.25, 0.5, 1.0, 2.0, 4.0, 6.0, 10.0)
    widths: tuple[int, ...] = ()
    thinnest: float = 1.0
    children: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        super().__post_init__()
        if any(width % 4 for width in self.widths):
            raise InputError(f"training: widths {self.widths} are not multiples of four")
        object.__setattr__(self, "alphas", tuple(sorted(set(map(float, self.alphas)))))

    def examples(self, clouds: Sequence[Floats]) -> Examples:
        """Cubes of the voxels of clouds (n, 3)."""
        from puckbench.codecs.learned.grid_level import on_dense_grids
        from puckbench.codecs.learned.training.examples import Examples

        voxels = [v for cloud in clouds for v in on_dense_grids(cloud, self.children)]
        fewest = max(1, _FEWEST * min(self.side, _SIDE) ** 2 // _SIDE**2)
        return Examples(voxels, self.side, self.cubes, fewest, self.thinnest, self.seed)

    def rates(self, known: Rates) -> dict[str, Mapping[str, Any]]:
        """Those of the entry with one of the alphas; if it has none of them, one for each alpha."""
        kept = {name: rate for name, rate in known.items() if rate["lmbda"] in self.alphas}
        return kept or {f"lmbda_{alpha:g}": {"lmbda": alpha} for alpha in self.alphas}


def _fits(value: Any, default: Any, free: bool = False, least: int | None = None) -> bool:
    """Whether a value is positive, or at least `least`, and of the default's kind and length."""
    if isinstance(default, tuple):
        if not isinstance(value, tuple) or not value:
            return False
        sized = free or len(value) == len(default)
        return sized and all(_fits(item, default[0]) for item in value)
    kinds = (int,) if isinstance(default, int) else (int, float)
    if isinstance(value, bool) or not isinstance(value, kinds):
        return False
    return 0 < value < inf if least is None else value >= least


def open_training(
    codec: str, entry: Mapping[str, Any] | None, settings: Mapping[str, Any]
) -> Training:
    """The training of a codec; InputError when it has none, or a setting cannot be.

    entry: a user's changes to the codec's entry.
    """
    where = training_class(codec, entry)
    found = {name: tuple(v) if isinstance(v, list) else v for name, v in settings.items()}
    try:
        training: Training = load_class(where, f"codec {codec}")(**found)
    except TypeError as error:
        raise InputError(f"codec {codec}: training: {error}") from error
    return training

"""Base classes of codecs that use a neural network.

A stream contains a digest, i.e. a hash of the weights, by which the decoder finds the weights file.
PyTorch is imported in the first call that encodes or decodes.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, Protocol, TypedDict, TypeVar

import numpy as np
from pydantic import Field

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.models import Model
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.rates import Parameters, parameters_of
from puckbench.codecs.unit import multiplied, with_unit, without_unit

if TYPE_CHECKING:
    from pcc_networks.catalogue import NetworkType

CODE = ("puckbench.codecs.base",)

_NEEDED = {"pcc_networks": "pcc_networks", "torch": "PyTorch", "constriction": "constriction"}
_INSTALL = "pip install 'puckbench[learned]', or make learned where its Makefile is"
PUBLISHED_WEIGHTS = "data/pcgc_weights"
"""Folder to which `puckbench data pcgc_weights` writes the weights of PCGCv1's and PCGCv2's
authors."""


def not_installed() -> str:
    """Return a message on missing packages of the learned codecs, or "" if all are installed.

    The message says how to install them.
    """
    missing = [name for module, name in _NEEDED.items() if find_spec(module) is None]
    return f"{' and '.join(missing)} not installed: {_INSTALL}" if missing else ""


def require_networks() -> None:
    """Raise InputError if the package `pcc_networks` is not installed.

    The message says how to install it.
    """
    if find_spec("pcc_networks") is None:
        raise InputError(not_installed())


class Weights(Protocol):
    """Trained weights of a network, as codecs use them."""

    @property
    def digest(self) -> bytes:
        """The 8 bytes that identify the weights in streams."""


class RateWeights(Weights, Protocol):
    """Trained weights that serve several rates, one for each Lagrangian weight of the training."""

    @property
    def lmbdas(self) -> tuple[float, ...]:
        """The Lagrangian weights of the training, the smallest bitrate first."""


W = TypeVar("W", bound=Weights)
R = TypeVar("R", bound=RateWeights)


class GridArguments(TypedDict, total=False):
    """Arguments that choose the encoder's grid (see `pcc_networks.choose_grid_level`)."""

    mean_occupied_children: float
    grid_level_offset: float


class LearnedOptions(Model):
    weights: str = Field("", description="a shipped set's name, a file, or a folder of weights")


class Learned(Codec, Generic[W]):
    """Base class of codecs with a neural network.

    By default, all rates use the same weights. A subclass defines `network`, `read_weights`,
    `encode_points` and `decode`; and `training`, if `puckbench train` shall train it. If the option
    `weights` selects several files, the encoder uses the first in alphabetical order.
    """

    training: ClassVar[str] = ""
    """Class of the training settings: ``module:Class``, or the name of a class in the codec's file;
    empty if there is no training."""
    network: ClassVar[str]
    """Name of the network, by which files of its weights are recognised, such as "reno"."""
    published_weights: ClassVar[str] = ""
    """Folder to which `puckbench data` writes the weights of the codec's authors, or empty."""
    Options: type[LearnedOptions] = LearnedOptions
    options: LearnedOptions

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._sets: dict[Path, W] = {}

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        return super().skip(cloud, rate) or not_installed() or self._lacking_weights(rate)

    def _lacking_weights(self, rate: str) -> str | None:
        try:
            if self._path(parameters_of(self, rate)):
                return None
            there = [name for name, values in self.rates.items() if self._path(values)]
        except InputError as error:
            return str(error)
        where = self.options.weights
        if not there:
            return f"{where} has no file of weights of {self.network}{self._how_to_fetch()}"
        return f"{where} has no weights for {rate} (rates it has: {', '.join(there)})"

    def _how_to_fetch(self) -> str:
        published = Path(self.published_weights).name
        return f": fetch them (puckbench data {published})" if published else ""

    def weights(self, rate: str) -> Path | None:
        if find_spec("pcc_networks") is None:
            return None
        return self._path(parameters_of(self, rate))

    def encode(self, cloud: PointCloud, rate: str, work: object = None) -> bytes:
        return self.encode_points(cloud.xyz, parameters_of(self, rate))

    @abstractmethod
    def encode_points(self, points: Floats, parameters: Parameters) -> bytes:
        """Encode points (n, 3) with the parameters of a rate, as `encode` does."""

    def _files(self) -> list[Path]:
        return self._network().files(self._where())

    def _network(self) -> NetworkType:
        require_networks()
        from pcc_networks.catalogue import NETWORKS, NetworkType

        return NETWORKS.get(self.network) or NetworkType(self.network)

    def _where(self) -> str:
        where = self.options.weights
        if not where:
            raise InputError("no weights: set the option weights")
        if where == self.published_weights and not Path(where).is_dir():
            raise InputError(f"no weights in {where}{self._how_to_fetch()}")
        return where

    def _known_files(self) -> Iterator[Path]:
        """Yield the files to search for a stream's weights, first those of the option `weights`."""
        yield from self._files()
        yield from self._network().shipped()

    def load(self) -> None:
        for parameters in self.rates.values():
            self.weights_of(parameters)
        self._try(list(self.rates.values())[:1])

    def _try(self, rates: Iterable[Parameters]) -> None:
        points = _trial_cloud()
        for parameters in rates:
            self.decode(self.encode_points(points, parameters))

    def weights_of(self, parameters: Parameters) -> W:
        """Return the weights that the parameters of a rate select; raise InputError without any."""
        path = self._path(parameters)
        if path is None:
            rate = ", ".join(f"{name} {value}" for name, value in parameters.items())
            raise InputError(f"{self.options.weights} has no weights for {rate}")
        return self._set(path)

    def weights_with(self, digest: bytes) -> W:
        """Return the weights that a digest in a stream names.

        They are searched among the files of the option `weights`, and those that are shipped.
        Raises InputError if there are none.
        """
        for path in self._known_files():
            weights = self._set(path)
            if weights.digest == digest:
                return weights
        where, made = self.options.weights, digest.hex()
        raise InputError(f"the stream was made with other weights ({made}) than {where} has")

    def _set(self, path: Path) -> W:
        if path not in self._sets:
            self._sets[path] = self.read_weights(path)
        return self._sets[path]

    def _path(self, parameters: Parameters) -> Path | None:
        return next(iter(self._files()), None)

    @abstractmethod
    def read_weights(self, path: Path) -> W:
        """Read a file of weights, which is called once; raise InputError if it is damaged."""


class PublishedOptions(LearnedOptions):
    weights: str = Field(PUBLISHED_WEIGHTS, description="a folder with the authors' weights")
    device: Literal["cpu", "cuda"] = Field("cpu", description="device on which the network runs")


class LearnedByLambda(Learned[R]):
    """Base class of published codecs that have separate weights for each rate.

    A rate's parameter `lmbda` selects the weights. It is the Lagrangian weight of the distortion in
    training. The subclass `Improved` adds puckbench's changes to such codecs.
    """

    published_weights = PUBLISHED_WEIGHTS
    Options: type[PublishedOptions] = PublishedOptions
    options: PublishedOptions
    context_mixing = False
    """Whether the latent is coded by context mixing. Otherwise it is coded by fixed tables in
    the weights."""
    point_reconstruction = False
    """Whether as many points are decoded as were encoded. Otherwise one point is decoded for
    each voxel."""

    def _known_files(self) -> Iterator[Path]:
        yield from super()._known_files()
        if Path(PUBLISHED_WEIGHTS).is_dir():
            yield from self._network().files(PUBLISHED_WEIGHTS)

    def _as_read(self, points: Floats) -> Floats:
        """Truncate points (n, 3) to integers, as the authors' PLY readers do."""
        return np.trunc(points)

    def _grid(self, parameters: Parameters) -> GridArguments:
        """Return the arguments that choose a rate's grid, or none to use the input's grid."""
        return GridArguments()

    def _path(self, parameters: Parameters) -> Path | None:
        return self._network().by_lmbda(self._where()).get(float(parameters["lmbda"]))

    def _numbered(self, parameters: Parameters) -> tuple[R, int]:
        weights = self.weights_of(parameters)
        return weights, weights.lmbdas.index(float(parameters["lmbda"]))

    def _of_rate(self, digest: bytes, rate: int) -> R:
        """Return the weights with a digest; raise InputError if they lack rate number `rate`."""
        weights = self.weights_with(digest)
        if rate >= len(weights.lmbdas):
            raise InputError("the stream is damaged (its rate)")
        return weights


class ImprovedOptions(PublishedOptions):
    context_mixing: bool = Field(
        True, description="code the latent by context mixing, not by the weights' tables alone"
    )
    point_reconstruction: bool = Field(
        True, description="decode as many points as were coded, not one in each voxel's centre"
    )
    unit: float | None = Field(
        None,
        gt=0,
        description="length in metres that is one step of the finest grid, for clouds in metres; "
        "by default coordinates are steps",
    )


class Improved(LearnedByLambda[R]):
    """Base class of published codecs to which puckbench adds changes and its own weights.

    The grid depends on the cloud's density (`choose_grid_level`). The latent is coded by context
    mixing. As many points are decoded as were encoded.
    """

    options: ImprovedOptions

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.context_mixing = self.options.context_mixing
        self.point_reconstruction = self.options.point_reconstruction

    def encode_points(self, points: Floats, parameters: Parameters) -> bytes:
        unit = self.options.unit
        stream = super().encode_points(points / (unit or 1), parameters)  # type: ignore[safe-super]
        return stream if unit is None else with_unit(stream, unit)

    def decode(self, stream: bytes) -> PointCloud:
        content, unit = without_unit(stream)
        cloud = super().decode(content)  # type: ignore[safe-super]
        return cloud if unit is None else PointCloud(multiplied(cloud.xyz, unit))

    def _as_read(self, points: Floats) -> Floats:
        return points

    def _grid(self, parameters: Parameters) -> GridArguments:
        return GridArguments(
            mean_occupied_children=float(parameters.get("mean_occupied_children", 1)),
            grid_level_offset=float(parameters.get("grid_level_offset", 0)),
        )


def _trial_cloud() -> Floats:
    """Return a small cloud (n, 3); encoding it compiles all functions before timed calls."""
    block = np.stack(np.meshgrid(*[np.arange(8.0)] * 3), axis=-1).reshape(-1, 3)
    x, y = np.stack(np.meshgrid(*[np.arange(40.0)] * 2), axis=-1).reshape(-1, 2).T
    wave = np.rint(20 + 8 * np.sin(x / 6) * np.cos(y / 5))
    return np.concatenate([block, np.column_stack([x, y, wave])])

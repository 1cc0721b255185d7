"""The codec of a network with trained weights: where they are, and which of them made a stream.

PyTorch is loaded only when something is coded.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from puckbench.codecs.base import Availability, Codec
from puckbench.codecs.learned.catalogue import Network
from puckbench.core.errors import InputError
from puckbench.core.files import sha256
from puckbench.geometry.cloud import Floats

_NEEDED = {"torch": "PyTorch", "constriction": "constriction"}
_DIGITS = 16
MOST_QUARTERS = 80
"""Of a halving, that a grid is made coarser."""


class Weights(Protocol):
    """Weights that were read."""

    @property
    def digest(self) -> bytes:
        """8 bytes by which streams name them."""


class RatedWeights(Weights, Protocol):
    """Weights for some rates."""

    @property
    def alphas(self) -> tuple[float, ...]:
        """Of the rates, the smallest bitrate first."""


W = TypeVar("W", bound=Weights)
R = TypeVar("R", bound=RatedWeights)


class Learned(Codec, Generic[W]):
    """A codec whose network has weights of its own: one set codes at every rate.

    A subclass says which `network` it is, how a file of weights is read, and how it codes. Of
    several sets the first by name codes. weights: name of a shipped set, a file, or a folder.
    threads: of the network; PyTorch's number by default.
    """

    network: Network

    def __init__(
        self, *, weights: str | None = None, threads: int | None = None, **entry: Any
    ) -> None:
        super().__init__(**entry)
        self.where = weights
        self.threads = threads
        self._sets: dict[Path, W] = {}

    def available(self) -> Availability:
        """Whether packages and weights for every rate are here."""
        missing = [name for module, name in _NEEDED.items() if find_spec(module) is None]
        if missing:
            return Availability(False, f"{' and '.join(missing)} not installed (make learned)")
        try:
            lacking = [name for name, rate in self.rates.items() if self._path(rate) is None]
        except InputError as error:
            return Availability(False, str(error))
        there = ", ".join(name for name in self.rates if name not in lacking) or "none"
        why = f"{self.where} has no weights for {', '.join(lacking)} (rates it has: {there})"
        return Availability(not lacking, why if lacking else "")

    def weights_of(self, rate: str) -> str:
        """Name and digest (16 hexadecimal digits) of the file with a rate's weights."""
        path = self._path(self.rates[rate])
        return f"{path.stem} {sha256(path)[:_DIGITS]}" if path else ""

    def load(self) -> None:
        """Load the weights of all rates, and compile what is compiled on first use."""
        for parameters in self.rates.values():
            self._weights(parameters)
        self._try(list(self.rates.values())[:1])

    def _try(self, rates: Iterable[Mapping[str, Any]]) -> None:
        cube = np.stack(np.meshgrid(*[np.arange(8.0)] * 3), axis=-1).reshape(-1, 3)
        for parameters in rates:
            self._decode(self._encode(cube, parameters))

    def _encode(self, points: Floats, parameters: Mapping[str, Any]) -> bytes:
        try:
            return self._stream(points, parameters)
        except InputError as error:
            raise InputError(f"codec {self.name}: {error}") from error

    def _decode(self, stream: bytes) -> Floats:
        try:
            return self._points(stream)
        except InputError as error:
            raise InputError(f"codec {self.name}: {error}") from error

    def _where(self) -> str:
        if self.where is None:
            raise InputError("no weights given (option weights: a folder, a file or a shipped set)")
        return self.where

    def _weights(self, parameters: Mapping[str, Any]) -> W:
        """The weights that a rate is coded with."""
        path = self._path(parameters)
        if path is None:
            rate = ", ".join(f"{name} {value}" for name, value in parameters.items())
            raise InputError(f"{self.where} has no weights for {rate}")
        return self._set(path)

    def _made_with(self, digest: bytes) -> W:
        """The weights that a stream names, given or shipped."""
        for path in chain(self.network.files(self._where()), self.network.shipped()):
            weights = self._set(path)
            if weights.digest == digest:
                return weights
        made = digest.hex()
        raise InputError(f"the stream was made with other weights ({made}) than {self.where} has")

    def _set(self, path: Path) -> W:
        if path not in self._sets:
            self._sets[path] = self._read(path)
        return self._sets[path]

    def _path(self, parameters: Mapping[str, Any]) -> Path | None:
        """The file with a rate's weights, if there is one; the same for all rates."""
        return next(iter(self.network.files(self._where())), None)

    @abstractmethod
    def _read(self, path: Path) -> W: ...

    @abstractmethod
    def _stream(self, points: Floats, parameters: Mapping[str, Any]) -> bytes: ...

    @abstractmethod
    def _points(self, stream: bytes) -> Floats: ...


class LearnedByAlpha(Learned[R]):
    """A codec whose rate is the alpha that its weights were trained with: some for each alpha.

    contexts: code the latent in contexts; otherwise with the weights' tables alone. fill: decode as
    many points as were coded, where the network expects them; otherwise one for each voxel, in its
    middle. as_published: as the authors' program, do neither, leave each grid as it is, and cut
    off what coordinates have behind the point, as their readers of PLY files do.
    """

    def __init__(
        self,
        *,
        as_published: bool = False,
        contexts: bool = True,
        fill: bool = True,
        **entry: Any,
    ) -> None:
        super().__init__(**entry)
        self.as_published = as_published
        self.contexts, self.fill = contexts and not as_published, fill and not as_published

    def _encode(self, points: Floats, parameters: Mapping[str, Any]) -> bytes:
        return super()._encode(np.trunc(points) if self.as_published else points, parameters)

    def _path(self, parameters: Mapping[str, Any]) -> Path | None:
        return self.network.by_alpha(self._where()).get(float(parameters["lmbda"]))

    def _numbered(self, parameters: Mapping[str, Any]) -> tuple[R, int]:
        """The weights of a rate, and its number among theirs."""
        weights = self._weights(parameters)
        return weights, weights.alphas.index(float(parameters["lmbda"]))

    def _of_rate(self, digest: bytes, rate: int) -> R:
        """The weights that a stream names, which must have as many rates as its number says."""
        weights = self._made_with(digest)
        if rate >= len(weights.alphas):
            raise InputError("the stream is damaged (its rate)")
        return weights


def dense_quarters(points: Floats, parameters: Mapping[str, Any]) -> int:
    """The level of the grid that a rate codes points (n, 3) on, in quarter octaves above their own.

    The grid is coarsened until a voxel has the rate's `mean_occupied_children`, and then
    by its `grid_level_offset` in octaves, which may be negative. Without `mean_occupied_children`
    the level is 0. It is never below 0 or above `MOST_QUARTERS`.
    """
    from puckbench.codecs.learned.grid_level import QUARTERS, halvings_of

    children = float(parameters.get("mean_occupied_children", 1))
    if children <= 1:
        return 0
    halved = halvings_of(points, children) + float(parameters.get("grid_level_offset", 0))
    return round(min(max(0.0, QUARTERS * halved), MOST_QUARTERS))

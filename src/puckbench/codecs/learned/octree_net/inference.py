"""The network on a level's voxels, as the coder needs it: whole numbers, no gradients, in chunks.

The sums are exact (see `fixed`), so what it says is what the model's own layers would say.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from torch import Tensor, nn

from puckbench.codecs.learned.octree_net.fixed_point import (
    MOST_ACTIVATION,
    UNITS,
    WEIGHT_UNITS,
    rounded,
    weight,
)
from puckbench.codecs.learned.octree_net.frequencies import Frequencies, powers
from puckbench.codecs.learned.octree_net.layers import (
    Floats32,
    Rows,
    around,
    down,
    head,
    returning,
    telling,
)
from puckbench.codecs.learned.octree_net.model import Head, Layer, OctreeNet
from puckbench.codecs.learned.octree_net.symbols import VALUES, Symbols
from puckbench.codecs.learned.sparse.thread_pool import Crew, Scratch
from puckbench.codecs.learned.sparse.voxels import Table

_CHUNK = 2**13

Matrix = tuple[Floats32, Floats32]
"""A kernel and a bias, flat, in whole numbers."""


def chunks_of(count: int) -> list[slice]:
    """Rows as they are worked on, one chunk after the other or at the same time."""
    return [slice(first, min(count, first + _CHUNK)) for first in range(0, count, _CHUNK)]


@dataclass(frozen=True)
class Network:
    """The whole numbers of a model, flat."""

    width: int
    top: Floats32
    before: list[Matrix]
    between: list[Matrix]
    heads: list[list[tuple[Matrix, Matrix]]]
    """Of first and of second symbols, for each group."""
    known: list[Floats32]
    """What first and second symbols tell."""
    down: Matrix


def network_of(model: OctreeNet) -> Network:
    """The whole numbers of a model."""
    return Network(
        model.shape.width,
        _whole(rounded(model.top), UNITS),
        _matrices(model.before),
        _matrices(model.between),
        [_heads(model.first_heads), _heads(model.second_heads)],
        [_whole(rounded(known), UNITS) for known in (model.first_known, model.second_known)],
        _matrix(model.down),
    )


def _heads(heads: nn.ModuleList) -> list[tuple[Matrix, Matrix]]:
    found = [cast(Head, one) for one in heads]
    return [(_matrix(one.hidden), _matrix(one.logits)) for one in found]


def _matrices(layers: nn.ModuleList) -> list[Matrix]:
    return [_matrix(cast(Layer, layer)) for layer in layers]


def _matrix(layer: Layer) -> Matrix:
    return _whole(weight(layer.kernel), WEIGHT_UNITS), _whole(rounded(layer.bias), UNITS)


def _whole(values: Tensor, units: int) -> Floats32:
    return np.asarray((values.detach() * units).cpu().numpy().ravel(), dtype=np.float32)


@dataclass(frozen=True)
class Features:
    """Features of a level's voxels (n * width), and what layers read of them."""

    all: Floats32
    active: Floats32


def start(network: Network, count: int) -> Features:
    """Of the voxels of the top level."""
    features = np.tile(network.top, count)
    return Features(features, features.clip(0, MOST_ACTIVATION))


def before_groups(network: Network, features: Features, table: Table, crew: Crew) -> Features:
    """Features of all voxels before anything of their children is known."""
    for layer in network.before:
        features = _before_group(network, layer, features, table, crew)
    return features


def _before_group(
    network: Network, layer: Matrix, features: Features, table: Table, crew: Crew
) -> Features:
    rows = np.arange(table.shape[1])
    made = Features(np.empty_like(features.all), np.empty_like(features.all))
    convolve, give_back = around(network.width), returning(network.width)

    def work(chunk: slice, _: Scratch) -> None:
        first, last = chunk.start, chunk.stop
        convolve(table, features.all, features.active, rows, first, last, *layer, made.all)
        give_back(made.all, first, last, rows, made.all, made.active)

    crew.over(len(rows), _CHUNK, work)
    return made


@dataclass(frozen=True)
class Group:
    """Rows of a level that are coded together, and their own features (m * width).

    Each of its functions works on a chunk of the rows; chunks are nobody else's business.
    """

    network: Network
    number: int
    rows: Rows
    own: Floats32

    def say_first(self, features: Features, table: Table, chunk: slice) -> Frequencies:
        """What is said of the first symbols, seeing all of the groups before."""
        width = self.network.width
        if self.number:
            around(width)(
                table, features.all, features.active, self.rows, chunk.start, chunk.stop,
                *self.network.between[self.number - 1], self.own,
            )  # fmt: skip
        else:
            every = features.all.reshape(-1, width)
            self.own.reshape(-1, width)[chunk] = every[self.rows[chunk]]
        return self._say(0, chunk)

    def say_second(self, chunk: slice, first: Symbols) -> Frequencies:
        """What is said of the second symbols, knowing the first."""
        self._tell(0, chunk, first)
        return self._say(1, chunk)

    def finish(self, chunk: slice, second: Symbols, features: Features) -> None:
        """Let the level know both symbols."""
        self._tell(1, chunk, second)
        give_back = returning(self.network.width)
        give_back(self.own, chunk.start, chunk.stop, self.rows, features.all, features.active)

    def _tell(self, half: int, chunk: slice, symbols: Symbols) -> None:
        tell = telling(self.network.width)
        tell(self.own, chunk.start, chunk.stop, self.network.known[half], symbols)

    def _say(self, half: int, chunk: slice) -> Frequencies:
        hidden, logits = self.network.heads[half][self.number]
        said = np.empty((chunk.stop - chunk.start, VALUES), np.int32)
        say = head(self.network.width)
        say(self.own, chunk.start, chunk.stop, *hidden, *logits, powers(), said)
        return said


def group_of(network: Network, number: int, rows: Rows) -> Group:
    """A group whose features are not known yet."""
    return Group(network, number, rows, np.empty(len(rows) * network.width, np.float32))


def below(network: Network, features: Features, slots: Rows, crew: Crew) -> Features:
    """Features of the children at `slots`, from those of their parents."""
    size = len(slots) * network.width
    made = Features(np.empty(size, np.float32), np.empty(size, np.float32))
    descend = down(network.width)

    def work(chunk: slice, _: Scratch) -> None:
        descend(
            features.active, slots, chunk.start, chunk.stop, *network.down, made.all, made.active
        )

    crew.over(len(slots), _CHUNK, work)
    return made

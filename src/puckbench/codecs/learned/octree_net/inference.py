"""The network on a level's voxels for coding: integers, no gradients, in chunks.

The sums are exact (see `fixed_point`), so that the results are those of the model's own layers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from torch import Tensor, nn

from puckbench.codecs.learned.octree_net.fixed_point import (
    MAX_ACTIVATION,
    UNITS,
    WEIGHT_UNITS,
    quantised,
    quantised_weight,
)
from puckbench.codecs.learned.octree_net.layers import (
    Floats32,
    Rows,
    convolution,
    embedding,
    head,
    scattering,
    upsampling,
)
from puckbench.codecs.learned.octree_net.model import Head, Layer, OctreeNet
from puckbench.codecs.learned.octree_net.symbols import VALUES, Frequencies, Symbols, powers_of_two
from puckbench.codecs.learned.sparse.thread_pool import Scratch, ThreadPool
from puckbench.codecs.learned.sparse.voxels import NeighbourTable

_CHUNK_ROWS = 2**13

Matrix = tuple[Floats32, Floats32]
"""A kernel and a bias, flat, as integers."""


def chunks_of(count: int) -> list[slice]:
    """The chunks that `count` rows are computed in, in order."""
    return [slice(first, min(count, first + _CHUNK_ROWS)) for first in range(0, count, _CHUNK_ROWS)]


@dataclass(frozen=True)
class Network:
    """The integers of a model, flat.

    Parameters
    ----------
    channels
        Of the features.
    root
        Features of a voxel of the top level.
    convolutions, group_convolutions
        Before the first group, and before each of the others.
    heads
        Hidden and last layer of the heads of first and of second symbols, for each group.
    embeddings
        Of first and of second symbols.
    upsampling
        From parents to children.
    """

    channels: int
    root: Floats32
    convolutions: list[Matrix]
    group_convolutions: list[Matrix]
    heads: list[list[tuple[Matrix, Matrix]]]
    embeddings: list[Floats32]
    upsampling: Matrix


def network_of(model: OctreeNet) -> Network:
    """The integers of a model."""
    embeddings = (model.first_embedding, model.second_embedding)
    return Network(
        model.shape.channels,
        _integers(quantised(model.root), UNITS),
        _matrices(model.convolutions),
        _matrices(model.group_convolutions),
        [_heads(model.first_heads), _heads(model.second_heads)],
        [_integers(quantised(values), UNITS) for values in embeddings],
        _matrix(model.upsampling),
    )


def _heads(heads: nn.ModuleList) -> list[tuple[Matrix, Matrix]]:
    found = [cast(Head, one) for one in heads]
    return [(_matrix(one.hidden), _matrix(one.logits)) for one in found]


def _matrices(layers: nn.ModuleList) -> list[Matrix]:
    return [_matrix(cast(Layer, layer)) for layer in layers]


def _matrix(layer: Layer) -> Matrix:
    kernel = _integers(quantised_weight(layer.kernel), WEIGHT_UNITS)
    return kernel, _integers(quantised(layer.bias), UNITS)


def _integers(values: Tensor, units: int) -> Floats32:
    return np.asarray((values.detach() * units).cpu().numpy().ravel(), dtype=np.float32)


@dataclass(frozen=True)
class Features:
    """Features of a level's voxels (n * channels,), and their activations."""

    all: Floats32
    active: Floats32


def root_features(network: Network, count: int) -> Features:
    """Features of the voxels of the top level."""
    features = np.tile(network.root, count)
    return Features(features, features.clip(0, MAX_ACTIVATION))


def convolved(
    network: Network, features: Features, table: NeighbourTable, pool: ThreadPool
) -> Features:
    """Features of a level's voxels before any of their children are known."""
    for layer in network.convolutions:
        features = _convolved(network, layer, features, table, pool)
    return features


def _convolved(
    network: Network, layer: Matrix, features: Features, table: NeighbourTable, pool: ThreadPool
) -> Features:
    rows = np.arange(table.shape[1])
    made = Features(np.empty_like(features.all), np.empty_like(features.all))
    convolve, scatter = convolution(network.channels), scattering(network.channels)

    def work(chunk: slice, _: Scratch) -> None:
        first, last = chunk.start, chunk.stop
        convolve(table, features.all, features.active, rows, first, last, *layer, made.all)
        scatter(made.all, first, last, rows, made.all, made.active)

    pool.map_chunks(len(rows), _CHUNK_ROWS, work)
    return made


@dataclass(frozen=True)
class Group:
    """Voxels of a level that are coded together; each method works on a chunk of them.

    Parameters
    ----------
    network
        The network.
    number
        Of the group.
    rows
        (m,), the voxels.
    own
        (m * channels,), their features.
    """

    network: Network
    number: int
    rows: Rows
    own: Floats32

    def predict_first(self, features: Features, table: NeighbourTable, chunk: slice) -> Frequencies:
        """Frequencies of the first symbols, by what is known of the groups before."""
        channels = self.network.channels
        if self.number:
            convolution(channels)(
                table, features.all, features.active, self.rows, chunk.start, chunk.stop,
                *self.network.group_convolutions[self.number - 1], self.own,
            )  # fmt: skip
        else:
            every = features.all.reshape(-1, channels)
            self.own.reshape(-1, channels)[chunk] = every[self.rows[chunk]]
        return self._predict(0, chunk)

    def predict_second(self, chunk: slice, first: Symbols) -> Frequencies:
        """Frequencies of the second symbols, given the first."""
        self._embed(0, chunk, first)
        return self._predict(1, chunk)

    def update(self, chunk: slice, second: Symbols, features: Features) -> None:
        """Add both symbols' embeddings to the features of the level."""
        self._embed(1, chunk, second)
        scatter = scattering(self.network.channels)
        scatter(self.own, chunk.start, chunk.stop, self.rows, features.all, features.active)

    def _embed(self, half: int, chunk: slice, symbols: Symbols) -> None:
        embed = embedding(self.network.channels)
        embed(self.own, chunk.start, chunk.stop, self.network.embeddings[half], symbols)

    def _predict(self, half: int, chunk: slice) -> Frequencies:
        hidden, logits = self.network.heads[half][self.number]
        predicted = np.empty((chunk.stop - chunk.start, VALUES), np.int32)
        predict = head(self.network.channels)
        predict(self.own, chunk.start, chunk.stop, *hidden, *logits, powers_of_two(), predicted)
        return predicted


def group_of(network: Network, number: int, rows: Rows) -> Group:
    """A group whose features are not known yet."""
    return Group(network, number, rows, np.empty(len(rows) * network.channels, np.float32))


def child_features(network: Network, features: Features, slots: Rows, pool: ThreadPool) -> Features:
    """Features of the children in slots ``8 * parent + child``, from those of their parents."""
    size = len(slots) * network.channels
    made = Features(np.empty(size, np.float32), np.empty(size, np.float32))
    upsample = upsampling(network.channels)

    def work(chunk: slice, _: Scratch) -> None:
        parents, first, last = features.active, chunk.start, chunk.stop
        upsample(parents, slots, first, last, *network.upsampling, made.all, made.active)

    pool.map_chunks(len(slots), _CHUNK_ROWS, work)
    return made

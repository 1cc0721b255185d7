"""The network on a level's voxels for coding: integers, no gradients, in chunks.

The sums are exact (see `fixed_point`), so that the results are those of the model's own layers.
`LevelPredictor` and `VoxelGroup` say what a coder needs; here are their compiled forms for the CPU.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar, cast

import numpy as np
from torch import Tensor, nn

from puckbench.learned.octree_net.fixed_point import (
    MAX_ACTIVATION,
    UNITS,
    WEIGHT_UNITS,
    quantised,
    quantised_weight,
)
from puckbench.learned.octree_net.layers import (
    Floats32,
    Rows,
    convolution,
    embedding,
    head,
    scattering,
    upsampling,
)
from puckbench.learned.octree_net.model import FixedPointLayer, OctreeNet, SymbolHead
from puckbench.learned.octree_net.symbols import VALUES, Frequencies, Symbols, powers_of_two
from puckbench.learned.sparse.thread_pool import Scratch, ThreadPool
from puckbench.learned.sparse.voxels import NeighbourTable

_CHUNK_ROWS = 2**13

Matrix = tuple[Floats32, Floats32]
"""A kernel and a bias, flat, as integers."""
F = TypeVar("F")
"""Features of a level's voxels."""


class VoxelGroup(Protocol):
    """Voxels of a level that are coded together; each method works on a chunk of them."""

    @property
    def number(self) -> int:
        """Of the group."""

    @property
    def rows(self) -> Rows:
        """(m,), the voxels."""

    def predict_first(self, chunk: slice) -> Frequencies:
        """Frequencies of the first symbols, by what is known of the groups before."""

    def predict_second(self, chunk: slice, first: Symbols) -> Frequencies:
        """Frequencies of the second symbols, given the first."""

    def update(self, chunk: slice, second: Symbols) -> None:
        """Add both symbols' embeddings to the features of the level."""


class LevelPredictor(Protocol[F]):
    """A network that predicts the symbols of a level."""

    def root_features(self, count: int) -> F:
        """Features of the voxels of the top level."""

    def convolved(self, features: F, table: NeighbourTable, pool: ThreadPool) -> F:
        """Features of a level's voxels before any of their children are known."""

    def group(self, number: int, rows: Rows, features: F, table: NeighbourTable) -> VoxelGroup:
        """A group of the level's voxels, when all groups before it are coded."""

    def child_features(self, features: F, slots: Rows, pool: ThreadPool) -> F:
        """Features of the children in slots ``8 * parent + child``, from those of their parents."""


def chunks_of(count: int) -> list[slice]:
    """The chunks that `count` rows are computed in, in order."""
    return [slice(first, min(count, first + _CHUNK_ROWS)) for first in range(0, count, _CHUNK_ROWS)]


@dataclass(frozen=True)
class CompiledFeatures:
    """Features of a level's voxels (n * channels,), and their activations."""

    all: Floats32
    active: Floats32


@dataclass(frozen=True)
class CompiledPredictor:
    """The integers of a model, flat, for compiled layers.

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

    def root_features(self, count: int) -> CompiledFeatures:
        """As in `LevelPredictor`."""
        features = np.tile(self.root, count)
        return CompiledFeatures(features, features.clip(0, MAX_ACTIVATION))

    def convolved(
        self, features: CompiledFeatures, table: NeighbourTable, pool: ThreadPool
    ) -> CompiledFeatures:
        """As in `LevelPredictor`."""
        for layer in self.convolutions:
            features = self._convolved(layer, features, table, pool)
        return features

    def _convolved(
        self, layer: Matrix, features: CompiledFeatures, table: NeighbourTable, pool: ThreadPool
    ) -> CompiledFeatures:
        rows = np.arange(table.shape[1])
        made = CompiledFeatures(np.empty_like(features.all), np.empty_like(features.all))
        convolve, scatter = convolution(self.channels), scattering(self.channels)

        def work(chunk: slice, _: Scratch) -> None:
            first, last = chunk.start, chunk.stop
            convolve(table, features.all, features.active, rows, first, last, *layer, made.all)
            scatter(made.all, first, last, rows, made.all, made.active)

        pool.map_chunks(len(rows), _CHUNK_ROWS, work)
        return made

    def group(
        self, number: int, rows: Rows, features: CompiledFeatures, table: NeighbourTable
    ) -> CompiledGroup:
        """As in `LevelPredictor`."""
        own = np.empty(len(rows) * self.channels, np.float32)
        return CompiledGroup(self, number, rows, features, table, own)

    def child_features(
        self, features: CompiledFeatures, slots: Rows, pool: ThreadPool
    ) -> CompiledFeatures:
        """As in `LevelPredictor`."""
        size = len(slots) * self.channels
        made = CompiledFeatures(np.empty(size, np.float32), np.empty(size, np.float32))
        upsample = upsampling(self.channels)

        def work(chunk: slice, _: Scratch) -> None:
            parents, first, last = features.active, chunk.start, chunk.stop
            upsample(parents, slots, first, last, *self.upsampling, made.all, made.active)

        pool.map_chunks(len(slots), _CHUNK_ROWS, work)
        return made


def compiled_network(model: OctreeNet) -> CompiledPredictor:
    """The integers of a model."""
    embeddings = (model.first_embedding, model.second_embedding)
    return CompiledPredictor(
        model.shape.channels,
        _integers(quantised(model.root), UNITS),
        _matrices(model.convolutions),
        _matrices(model.group_convolutions),
        [_heads(model.first_heads), _heads(model.second_heads)],
        [_integers(quantised(values), UNITS) for values in embeddings],
        _matrix(model.upsampling),
    )


def _heads(heads: nn.ModuleList) -> list[tuple[Matrix, Matrix]]:
    found = [cast(SymbolHead, one) for one in heads]
    return [(_matrix(one.hidden), _matrix(one.logits)) for one in found]


def _matrices(layers: nn.ModuleList) -> list[Matrix]:
    return [_matrix(cast(FixedPointLayer, layer)) for layer in layers]


def _matrix(layer: FixedPointLayer) -> Matrix:
    kernel = _integers(quantised_weight(layer.kernel), WEIGHT_UNITS)
    return kernel, _integers(quantised(layer.bias), UNITS)


def _integers(values: Tensor, units: int) -> Floats32:
    return np.asarray((values.detach() * units).cpu().numpy().ravel(), dtype=np.float32)


@dataclass(frozen=True)
class CompiledGroup:
    """A group, with the features of its voxels `own` (m * channels,)."""

    network: CompiledPredictor
    number: int
    rows: Rows
    features: CompiledFeatures
    table: NeighbourTable
    own: Floats32

    def predict_first(self, chunk: slice) -> Frequencies:
        """As in `VoxelGroup`."""
        channels, features = self.network.channels, self.features
        if self.number:
            convolution(channels)(
                self.table, features.all, features.active, self.rows, chunk.start, chunk.stop,
                *self.network.group_convolutions[self.number - 1], self.own,
            )  # fmt: skip
        else:
            every = features.all.reshape(-1, channels)
            self.own.reshape(-1, channels)[chunk] = every[self.rows[chunk]]
        return self._predict(0, chunk)

    def predict_second(self, chunk: slice, first: Symbols) -> Frequencies:
        """As in `VoxelGroup`."""
        self._embed(0, chunk, first)
        return self._predict(1, chunk)

    def update(self, chunk: slice, second: Symbols) -> None:
        """As in `VoxelGroup`."""
        self._embed(1, chunk, second)
        scatter, features = scattering(self.network.channels), self.features
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

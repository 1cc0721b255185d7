"""Inference of the sparse octree net in chunks of a level's voxels; results equal the model's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from torch import Tensor, nn

from pcc_networks.octree_net.fixed_point import (
    MAX_ACTIVATION,
    UNITS,
    WEIGHT_UNITS,
    quantised,
    quantised_weight,
)
from pcc_networks.octree_net.layers import (
    Floats32,
    Rows,
    convolution,
    embedding,
    head,
    scattering,
    upsampling,
)
from pcc_networks.octree_net.model import FixedPointLayer, OctreeNet, SymbolHead
from pcc_networks.octree_net.symbols import VALUES, Frequencies, Symbols, powers_of_two
from pcc_networks.sparse.thread_pool import Scratch, ThreadPool
from pcc_networks.sparse.voxels import NeighbourTable

CHUNK_ROWS = 2**13

Matrix = tuple[Floats32, Floats32]
"""Flat arrays of a layer's kernel and bias, with integer values."""


@dataclass(frozen=True)
class CompiledFeatures:
    all: Floats32  # (n * channels,)
    active: Floats32  # their activations


@dataclass(frozen=True)
class CompiledPredictor:
    """A model's integer weights in flat arrays, for compiled layers."""

    channels: int
    root: Floats32  # features of a voxel of the top level
    convolutions: list[Matrix]  # before the first group
    group_convolutions: list[Matrix]  # before each of the other groups
    # hidden and last layer (two matrices) for first and second symbols, for each group
    heads: list[list[tuple[Floats32, ...]]]
    embeddings: list[Floats32]  # of first and of second symbols
    upsampling: Matrix  # from parents to children

    def root_features(self, count: int) -> CompiledFeatures:
        features = np.tile(self.root, count)
        return CompiledFeatures(features, features.clip(0, MAX_ACTIVATION))

    def convolved(
        self, features: CompiledFeatures, table: NeighbourTable, pool: ThreadPool
    ) -> CompiledFeatures:
        for layer in self.convolutions:
            features = self._convolved(layer, features, table, pool)
        return features

    def _convolved(
        self, layer: Matrix, features: CompiledFeatures, table: NeighbourTable, pool: ThreadPool
    ) -> CompiledFeatures:
        rows = np.arange(table.shape[1])
        result = CompiledFeatures(np.empty_like(features.all), np.empty_like(features.all))
        convolve = convolution(self.channels)

        def work(chunk: slice, _: Scratch) -> None:
            first, last = chunk.start, chunk.stop
            convolve(table, features.all, features.active, rows, first, last, *layer, result.all)
            span = slice(first * self.channels, last * self.channels)
            np.clip(result.all[span], 0, MAX_ACTIVATION, out=result.active[span])

        pool.map_chunks(len(rows), CHUNK_ROWS, work)
        return result

    def group(
        self, number: int, rows: Rows, features: CompiledFeatures, table: NeighbourTable
    ) -> CompiledGroup:
        group_features = np.empty(len(rows) * self.channels, np.float32)
        return CompiledGroup(self, number, rows, features, table, group_features)

    def child_features(
        self, features: CompiledFeatures, slots: Rows, pool: ThreadPool
    ) -> CompiledFeatures:
        size = len(slots) * self.channels
        result = CompiledFeatures(np.empty(size, np.float32), np.empty(size, np.float32))
        upsample = upsampling(self.channels)

        def work(chunk: slice, _: Scratch) -> None:
            parents, first, last = features.active, chunk.start, chunk.stop
            upsample(parents, slots, first, last, *self.upsampling, result.all, result.active)

        pool.map_chunks(len(slots), CHUNK_ROWS, work)
        return result


def compiled_network(model: OctreeNet) -> CompiledPredictor:
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


def _heads(heads: nn.ModuleList) -> list[tuple[Floats32, ...]]:
    symbol_heads = (cast(SymbolHead, symbol_head) for symbol_head in heads)
    return [(*_matrix(each.hidden), *_matrix(each.logits)) for each in symbol_heads]


def _matrices(layers: nn.ModuleList) -> list[Matrix]:
    return [_matrix(cast(FixedPointLayer, layer)) for layer in layers]


def _matrix(layer: FixedPointLayer) -> Matrix:
    kernel = _integers(quantised_weight(layer.kernel), WEIGHT_UNITS)
    return kernel, _integers(quantised(layer.bias), UNITS)


def _integers(values: Tensor, units: int) -> Floats32:
    return np.asarray((values.detach() * units).cpu().numpy().ravel(), dtype=np.float32)


@dataclass(frozen=True)
class CompiledGroup:
    network: CompiledPredictor
    number: int
    rows: Rows
    features: CompiledFeatures
    table: NeighbourTable
    group_features: Floats32  # (m * channels,), features of the group's voxels

    def predict_first(self, chunk: slice) -> Frequencies:
        channels, features = self.network.channels, self.features
        if self.number:
            convolution(channels)(
                self.table, features.all, features.active, self.rows, chunk.start, chunk.stop,
                *self.network.group_convolutions[self.number - 1], self.group_features,
            )  # fmt: skip
        else:
            self._rows(self.group_features)[chunk] = self._rows(features.all)[self.rows[chunk]]
        return self._predict(0, chunk)

    def predict_second(self, chunk: slice, first: Symbols) -> Frequencies:
        self._embed(0, chunk, first)
        return self._predict(1, chunk)

    def update(self, chunk: slice, second: Symbols) -> None:
        self._embed(1, chunk, second)
        scattering(self.network.channels)(
            self.group_features, chunk.start, chunk.stop, self.rows, self.features.all,
            self.features.active,
        )  # fmt: skip

    def _rows(self, features: Floats32) -> Floats32:
        return features.reshape(-1, self.network.channels)

    def _embed(self, half: int, chunk: slice, symbols: Symbols) -> None:
        embed = embedding(self.network.channels)
        embed(self.group_features, chunk.start, chunk.stop, self.network.embeddings[half], symbols)

    def _predict(self, half: int, chunk: slice) -> Frequencies:
        predicted = np.empty((chunk.stop - chunk.start, VALUES), np.int32)
        head(self.network.channels)(
            self.group_features, chunk.start, chunk.stop, *self.network.heads[half][self.number],
            powers_of_two(), predicted,
        )  # fmt: skip
        return predicted

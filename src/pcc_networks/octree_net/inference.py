"""Inference of the sparse octree net in compiled layers, by chunks of a level's voxels.

The results equal those of the layers in `model`, which training needs for their gradients. With
these layers, inference would take twice as long as the whole encoder takes now. All numbers are
integers that are stored as 32-bit floats: features and biases are in units of 2**-5, weights of
2**-9, sums of 2**-14 (see `model`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from typing import cast

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, nn

from pcc_networks.octree_net.model import (
    MAX_ACTIVATION,
    MAX_RESIDUAL,
    UNITS,
    WEIGHT_UNITS,
    FixedPointLayer,
    OctreeNet,
    SymbolHead,
    quantised,
    quantised_weight,
)
from pcc_networks.octree_net.symbols import VALUES, Frequencies, Symbols
from pcc_networks.sparse.thread_pool import Scratch, ThreadPool
from pcc_networks.sparse.voxels import CHILDREN, OFFSETS, NeighbourTable
from pointkit.coding.intrinsics import add_products
from pointkit.compiling import compiled

Floats32 = NDArray[np.float32]
Rows = NDArray[np.int64]
_BLOCK_ROWS = 128
"""Rows whose sums fit the first-level cache."""
_ROUNDER = np.float32(1.5 * 2**23)
"""Adding and then subtracting this number rounds a float to the nearest integer, ties to even."""
_UNITS, _RESIDUAL = np.float32(WEIGHT_UNITS), np.float32(MAX_RESIDUAL)
_ACTIVATION, _ZERO = np.float32(MAX_ACTIVATION), np.float32(0)


@compiled
def residual(total: np.float32) -> np.float32:
    """Round a sum in units of 2**-14 to a feature in units of 2**-5, and clip it."""
    rounded = (total / _UNITS + _ROUNDER) - _ROUNDER
    return min(max(rounded, -_RESIDUAL), _RESIDUAL)


@compiled
def activation(feature: np.float32) -> np.float32:
    """Apply the clipped ReLU to a feature."""
    return min(max(feature, _ZERO), _ACTIVATION)


@cache
def convolution(channels: int) -> Callable[..., None]:
    """Compile a 3x3x3 convolution whose result is added to the features of selected rows."""

    def convolve(
        table: NeighbourTable, features: Floats32, active: Floats32, rows: Rows, first: int,
        last: int, kernel: Floats32, bias: Floats32, row_features: Floats32,
    ) -> None:  # fmt: skip
        sums = np.empty(_BLOCK_ROWS * channels, np.float32)
        targets, sources = np.empty(_BLOCK_ROWS, np.int64), np.empty(_BLOCK_ROWS, np.int64)
        for start in range(first, last, _BLOCK_ROWS):
            count = min(_BLOCK_ROWS, last - start)
            for i in range(count):
                at = rows[start + i] * channels
                for j in range(channels):
                    sums[i * channels + j] = (features[at + j] + bias[j]) * _UNITS
            for offset in range(OFFSETS):
                pairs = 0
                for i in range(count):
                    neighbour = table[offset, rows[start + i]]
                    # overwritten by the next neighbour if there is none
                    targets[pairs], sources[pairs] = i, neighbour
                    pairs += neighbour >= 0
                add_products(
                    sums, targets, active, sources, pairs, kernel, offset * channels * channels,
                    channels, channels,
                )  # fmt: skip
            for k in range(count * channels):
                row_features[start * channels + k] = residual(sums[k])

    return compiled(convolve)


@cache
def head(channels: int) -> Callable[..., None]:
    """Compile the layers that predict the frequencies (16) of a symbol from features."""

    def predict(
        row_features: Floats32, first: int, last: int, hidden: Floats32, hidden_bias: Floats32,
        logits: Floats32, logits_bias: Floats32, powers: NDArray[np.int32],
        predicted: NDArray[np.int32],
    ) -> None:  # fmt: skip
        active, hidden_sums = np.empty((2, _BLOCK_ROWS * channels), np.float32)
        sums = np.empty(_BLOCK_ROWS * VALUES, np.float32)
        all_rows = np.arange(_BLOCK_ROWS)
        max_distance = np.float32(len(powers) - 1)
        for start in range(first, last, _BLOCK_ROWS):
            count = min(_BLOCK_ROWS, last - start)
            for k in range(count * channels):
                active[k] = activation(row_features[start * channels + k])
                hidden_sums[k] = hidden_bias[k % channels] * _UNITS
            add_products(
                hidden_sums, all_rows, active, all_rows, count, hidden, 0, channels, channels
            )
            for k in range(count * channels):
                active[k] = activation(residual(hidden_sums[k]))
            for k in range(count * VALUES):
                sums[k] = logits_bias[k % VALUES] * _UNITS
            add_products(sums, all_rows, active, all_rows, count, logits, 0, channels, VALUES)
            for i in range(count):
                max_logit = -_RESIDUAL
                for j in range(VALUES):
                    sums[i * VALUES + j] = residual(sums[i * VALUES + j])
                    max_logit = max(max_logit, sums[i * VALUES + j])
                for j in range(VALUES):
                    distance = min(max_logit - sums[i * VALUES + j], max_distance)
                    predicted[start - first + i, j] = powers[np.int64(distance)]

    return compiled(predict)


@cache
def embedding(channels: int) -> Callable[..., None]:
    """Compile the addition of coded symbols to features."""

    def embed(
        row_features: Floats32, first: int, last: int, embeddings: Floats32, symbols: Symbols
    ) -> None:
        for i in range(first, last):
            at, value = i * channels, np.int64(symbols[i - first]) * channels
            for j in range(channels):
                total = row_features[at + j] + embeddings[value + j]
                row_features[at + j] = min(max(total, -_RESIDUAL), _RESIDUAL)

    return compiled(embed)


@cache
def scattering(channels: int) -> Callable[..., None]:
    """Compile the copying of the features of a group to those of the level."""

    def scatter(
        row_features: Floats32, first: int, last: int, rows: Rows, features: Floats32,
        active: Floats32,
    ) -> None:  # fmt: skip
        for i in range(first, last):
            at, level_at = i * channels, rows[i] * channels
            for j in range(channels):
                features[level_at + j] = row_features[at + j]
                active[level_at + j] = activation(row_features[at + j])

    return compiled(scatter)


@cache
def upsampling(channels: int) -> Callable[..., None]:
    """Compile the layer that computes the features of children from those of their parents."""

    def upsample(
        parents: Floats32, slots: Rows, first: int, last: int, kernel: Floats32, bias: Floats32,
        features: Floats32, active: Floats32,
    ) -> None:  # fmt: skip
        sums = np.empty(_BLOCK_ROWS * channels, np.float32)
        targets, sources = np.empty(_BLOCK_ROWS, np.int64), np.empty(_BLOCK_ROWS, np.int64)
        for start in range(first, last, _BLOCK_ROWS):
            count = min(_BLOCK_ROWS, last - start)
            for k in range(count * channels):
                sums[k] = bias[k % channels] * _UNITS
            for child in range(CHILDREN):
                pairs = 0
                for i in range(count):
                    targets[pairs], sources[pairs] = i, slots[start + i] >> 3
                    pairs += slots[start + i] & 7 == child
                add_products(
                    sums, targets, parents, sources, pairs, kernel, child * channels * channels,
                    channels, channels,
                )  # fmt: skip
            for k in range(count * channels):
                feature = residual(sums[k])
                features[start * channels + k] = feature
                active[start * channels + k] = activation(feature)

    return compiled(upsample)


CHUNK_ROWS = 2**13
_FREQUENCY_BITS = 16
_MIN_FREQUENCY = 8

Matrix = tuple[Floats32, Floats32]
"""Flat arrays of a layer's kernel and bias, with integer values."""


@dataclass(frozen=True)
class CompiledFeatures:
    """Features of all voxels of a level."""

    all: Floats32  # (n * channels,)
    active: Floats32  # their activations


@dataclass(frozen=True)
class CompiledPredictor:
    """The network with its weights as integers in flat arrays, for inference by compiled layers."""

    channels: int
    root: Floats32  # features of a voxel of the top level
    convolutions: list[Matrix]  # before the first group
    group_convolutions: list[Matrix]  # before each of the other groups
    # hidden and last layer (two matrices) for first and second symbols, for each group
    heads: list[list[tuple[Floats32, ...]]]
    embeddings: list[Floats32]  # of first and of second symbols
    upsampling: Matrix  # from parents to children

    def root_features(self, count: int) -> CompiledFeatures:
        """Return the features of the `count` voxels of the top level."""
        features = np.tile(self.root, count)
        return CompiledFeatures(features, features.clip(0, MAX_ACTIVATION))

    def convolved(
        self, features: CompiledFeatures, table: NeighbourTable, pool: ThreadPool
    ) -> CompiledFeatures:
        """Apply the convolutions that precede the first group of a level."""
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
        """Return the predictor of the group with this number, for the voxels at `rows`."""
        group_features = np.empty(len(rows) * self.channels, np.float32)
        return CompiledGroup(self, number, rows, features, table, group_features)

    def child_features(
        self, features: CompiledFeatures, slots: Rows, pool: ThreadPool
    ) -> CompiledFeatures:
        """Return the features of the children at slots (m,) from those of their parents."""
        size = len(slots) * self.channels
        result = CompiledFeatures(np.empty(size, np.float32), np.empty(size, np.float32))
        upsample = upsampling(self.channels)

        def work(chunk: slice, _: Scratch) -> None:
            parents, first, last = features.active, chunk.start, chunk.stop
            upsample(parents, slots, first, last, *self.upsampling, result.all, result.active)

        pool.map_chunks(len(slots), CHUNK_ROWS, work)
        return result


def compiled_network(model: OctreeNet) -> CompiledPredictor:
    """Convert a network for inference."""
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
    """Predicts the symbols of the voxels of a group, chunk by chunk."""

    network: CompiledPredictor
    number: int
    rows: Rows
    features: CompiledFeatures
    table: NeighbourTable
    group_features: Floats32  # (m * channels,), features of the group's voxels

    def predict_first(self, chunk: slice) -> Frequencies:
        """Return the frequencies (k, 16) of the first symbols of a chunk of voxels."""
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
        """Return the frequencies (k, 16) of the second symbols, given the first symbols (k,)."""
        self._embed(0, chunk, first)
        return self._predict(1, chunk)

    def update(self, chunk: slice, second: Symbols) -> None:
        """Add the second symbols (k,) to the features, for the groups that follow."""
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


@cache
def powers_of_two() -> Frequencies:
    """Return 2**(16 - d / UNITS), rounded, for d = 0, 1, ..., down to `_MIN_FREQUENCY`."""
    steps = range((_FREQUENCY_BITS - 3) * UNITS + 1)
    exact = [Decimal(2) ** (_FREQUENCY_BITS - Decimal(d) / UNITS) for d in steps]
    return np.array([round(power) for power in exact], dtype=np.int32)

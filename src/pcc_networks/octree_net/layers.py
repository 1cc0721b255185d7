"""Compiled layers of the sparse octree net: convolution, heads, embeddings, upsampling.

All numbers are integers stored as 32-bit floats. Features and biases are in units of 2**-5, weights
of 2**-9, sums of 2**-14 (see `fixed_point`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pcc_networks.octree_net.fixed_point import MAX_ACTIVATION, MAX_RESIDUAL, WEIGHT_UNITS
from pcc_networks.octree_net.symbols import VALUES, Symbols
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
    rounded = (total / _UNITS + _ROUNDER) - _ROUNDER
    return min(max(rounded, -_RESIDUAL), _RESIDUAL)


@compiled
def activation(feature: np.float32) -> np.float32:
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

"""Compiled layers of the learned octree coder: convolution, heads, embeddings, upsampling.

All numbers are integers in 32-bit floats, which hold them exactly: features and biases count units
of the residual stream, weights their own units, sums the product of both (see `fixed_point`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from puckbench.coding.matrix_products import add_products
from puckbench.core.compiling import compiled
from puckbench.learned.octree_net.fixed_point import (
    MAX_ACTIVATION,
    MAX_RESIDUAL,
    WEIGHT_UNITS,
)
from puckbench.learned.octree_net.symbols import VALUES, Symbols
from puckbench.learned.sparse.voxels import CHILDREN, OFFSETS, NeighbourTable

Floats32 = NDArray[np.float32]
Rows = NDArray[np.int64]
_BLOCK_ROWS = 128
"""Rows whose sums stay in a core's nearest cache."""
_ROUNDER = np.float32(1.5 * 2**23)
"""A number that rounds a float to the nearest integer, halves to even, when it is added and
subtracted again."""
_UNITS, _RESIDUAL = np.float32(WEIGHT_UNITS), np.float32(MAX_RESIDUAL)
_ACTIVATION, _ZERO = np.float32(MAX_ACTIVATION), np.float32(0)


@compiled
def residual(total: np.float32) -> np.float32:
    """A sum as the residual stream carries it on: in its units, rounded and clipped."""
    whole = (total / _UNITS + _ROUNDER) - _ROUNDER
    return min(max(whole, -_RESIDUAL), _RESIDUAL)


@compiled
def activation(feature: np.float32) -> np.float32:
    """The clipped ReLU, through which a layer reads a feature."""
    return min(max(feature, _ZERO), _ACTIVATION)


@cache
def convolution(channels: int) -> Callable[..., None]:
    """A compiled 3x3x3 convolution that is added to the features of some rows of a level."""

    def convolve(
        table: NeighbourTable, features: Floats32, active: Floats32, rows: Rows, first: int,
        last: int, kernel: Floats32, bias: Floats32, own: Floats32,
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
                    other = table[offset, rows[start + i]]
                    targets[pairs], sources[pairs] = (
                        i,
                        other,
                    )  # overwritten by the next one if there is none
                    pairs += other >= 0
                add_products(
                    sums, targets, active, sources, pairs, kernel, offset * channels * channels,
                    channels, channels,
                )  # fmt: skip
            for k in range(count * channels):
                own[start * channels + k] = residual(sums[k])

    return compiled(convolve)


@cache
def head(channels: int) -> Callable[..., None]:
    """A compiled head of two layers, from features to frequencies of symbols."""

    def predict(
        own: Floats32, first: int, last: int, hidden: Floats32, hidden_bias: Floats32,
        logits: Floats32, logits_bias: Floats32, powers: NDArray[np.int32],
        predicted: NDArray[np.int32],
    ) -> None:  # fmt: skip
        active, made = np.empty((2, _BLOCK_ROWS * channels), np.float32)
        sums = np.empty(_BLOCK_ROWS * VALUES, np.float32)
        every = np.arange(_BLOCK_ROWS)
        least = np.float32(len(powers) - 1)
        for start in range(first, last, _BLOCK_ROWS):
            count = min(_BLOCK_ROWS, last - start)
            for k in range(count * channels):
                active[k] = activation(own[start * channels + k])
                made[k] = hidden_bias[k % channels] * _UNITS
            add_products(made, every, active, every, count, hidden, 0, channels, channels)
            for k in range(count * channels):
                active[k] = activation(residual(made[k]))
            for k in range(count * VALUES):
                sums[k] = logits_bias[k % VALUES] * _UNITS
            add_products(sums, every, active, every, count, logits, 0, channels, VALUES)
            for i in range(count):
                most = -_RESIDUAL
                for j in range(VALUES):
                    sums[i * VALUES + j] = residual(sums[i * VALUES + j])
                    most = max(most, sums[i * VALUES + j])
                for j in range(VALUES):
                    below = min(most - sums[i * VALUES + j], least)
                    predicted[start - first + i, j] = powers[np.int64(below)]

    return compiled(predict)


@cache
def embedding(channels: int) -> Callable[..., None]:
    """A compiled addition of the embeddings of symbols to features."""

    def embed(own: Floats32, first: int, last: int, embeddings: Floats32, symbols: Symbols) -> None:
        for i in range(first, last):
            at, value = i * channels, np.int64(symbols[i - first]) * channels
            for j in range(channels):
                total = own[at + j] + embeddings[value + j]
                own[at + j] = min(max(total, -_RESIDUAL), _RESIDUAL)

    return compiled(embed)


@cache
def scattering(channels: int) -> Callable[..., None]:
    """A compiled copy of the features of some rows to those of their level, and activations."""

    def scatter(
        own: Floats32, first: int, last: int, rows: Rows, features: Floats32, active: Floats32
    ) -> None:
        for i in range(first, last):
            at, into = i * channels, rows[i] * channels
            for j in range(channels):
                features[into + j] = own[at + j]
                active[into + j] = activation(own[at + j])

    return compiled(scatter)


@cache
def upsampling(channels: int) -> Callable[..., None]:
    """A compiled layer from the activations of parents to the features of their children."""

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

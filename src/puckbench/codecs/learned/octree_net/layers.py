"""Layers on rows of voxels, compiled: convolution, heads, what symbols tell, children.

All numbers are whole, in 32-bit floats that hold them exactly: features and biases count units of
the residual stream, weights their own units, sums both multiplied (see `fixed`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.learned.octree_net.fixed_point import (
    MOST_ACTIVATION,
    MOST_STREAM,
    WEIGHT_UNITS,
)
from puckbench.codecs.learned.octree_net.matrix_products import add_products
from puckbench.codecs.learned.octree_net.symbols import VALUES, Symbols
from puckbench.codecs.learned.sparse.voxels import CHILDREN, OFFSETS, Table
from puckbench.core.compiling import compiled

Floats32 = NDArray[np.float32]
Rows = NDArray[np.int64]
_BLOCK = 128
"""Rows whose sums stay in a core's nearest cache."""
_ROUNDER = np.float32(1.5 * 2**23)
"""Added and subtracted again, it leaves the nearest whole number, halves to even."""
_UNITS, _STREAM = np.float32(WEIGHT_UNITS), np.float32(MOST_STREAM)
_ACTIVATION, _NONE = np.float32(MOST_ACTIVATION), np.float32(0)


@compiled
def streamed(total: np.float32) -> np.float32:
    """A sum as the residual stream carries it on."""
    whole = (total / _UNITS + _ROUNDER) - _ROUNDER
    return min(max(whole, -_STREAM), _STREAM)


@compiled
def activated(feature: np.float32) -> np.float32:
    """What a layer reads of a feature."""
    return min(max(feature, _NONE), _ACTIVATION)


@cache
def around(width: int) -> Callable[..., None]:
    """Adds a 3x3x3 layer to features of some of a level's rows: see `Rows`."""

    def convolve(
        table: Table, features: Floats32, active: Floats32, rows: Rows, first: int, last: int,
        kernel: Floats32, bias: Floats32, own: Floats32,
    ) -> None:  # fmt: skip
        sums = np.empty(_BLOCK * width, np.float32)
        targets, sources = np.empty(_BLOCK, np.int64), np.empty(_BLOCK, np.int64)
        for start in range(first, last, _BLOCK):
            count = min(_BLOCK, last - start)
            for i in range(count):
                at = rows[start + i] * width
                for j in range(width):
                    sums[i * width + j] = (features[at + j] + bias[j]) * _UNITS
            for offset in range(OFFSETS):
                pairs = 0
                for i in range(count):
                    other = table[offset, rows[start + i]]
                    targets[pairs], sources[pairs] = i, other  # the next one's place if none
                    pairs += other >= 0
                add_products(
                    sums, targets, active, sources, pairs, kernel, offset * width * width,
                    width, width,
                )  # fmt: skip
            for k in range(count * width):
                own[start * width + k] = streamed(sums[k])

    return compiled(convolve)


@cache
def head(width: int) -> Callable[..., None]:
    """Frequencies of symbols by a head of two layers."""

    def say(
        own: Floats32, first: int, last: int, hidden: Floats32, hidden_bias: Floats32,
        logits: Floats32, logits_bias: Floats32, powers: NDArray[np.int32],
        said: NDArray[np.int32],
    ) -> None:  # fmt: skip
        read, made = np.empty((2, _BLOCK * width), np.float32)
        sums = np.empty(_BLOCK * VALUES, np.float32)
        every = np.arange(_BLOCK)
        least = np.float32(len(powers) - 1)
        for start in range(first, last, _BLOCK):
            count = min(_BLOCK, last - start)
            for k in range(count * width):
                read[k] = activated(own[start * width + k])
                made[k] = hidden_bias[k % width] * _UNITS
            add_products(made, every, read, every, count, hidden, 0, width, width)
            for k in range(count * width):
                read[k] = activated(streamed(made[k]))
            for k in range(count * VALUES):
                sums[k] = logits_bias[k % VALUES] * _UNITS
            add_products(sums, every, read, every, count, logits, 0, width, VALUES)
            for i in range(count):
                most = -_STREAM
                for j in range(VALUES):
                    sums[i * VALUES + j] = streamed(sums[i * VALUES + j])
                    most = max(most, sums[i * VALUES + j])
                for j in range(VALUES):
                    below = min(most - sums[i * VALUES + j], least)
                    said[start - first + i, j] = powers[np.int64(below)]

    return compiled(say)


@cache
def telling(width: int) -> Callable[..., None]:
    """Adds to features what a symbol tells."""

    def tell(own: Floats32, first: int, last: int, known: Floats32, symbols: Symbols) -> None:
        for i in range(first, last):
            at, value = i * width, np.int64(symbols[i - first]) * width
            for j in range(width):
                total = own[at + j] + known[value + j]
                own[at + j] = min(max(total, -_STREAM), _STREAM)

    return compiled(tell)


@cache
def returning(width: int) -> Callable[..., None]:
    """Puts features of some rows back among a level's, and what layers read of them."""

    def give_back(
        own: Floats32, first: int, last: int, rows: Rows, features: Floats32, active: Floats32
    ) -> None:
        for i in range(first, last):
            at, into = i * width, rows[i] * width
            for j in range(width):
                features[into + j] = own[at + j]
                active[into + j] = activated(own[at + j])

    return compiled(give_back)


@cache
def down(width: int) -> Callable[..., None]:
    """Features of children from those of their parents, and what layers read of them."""

    def descend(
        read: Floats32, slots: Rows, first: int, last: int, kernel: Floats32, bias: Floats32,
        features: Floats32, active: Floats32,
    ) -> None:  # fmt: skip
        sums = np.empty(_BLOCK * width, np.float32)
        targets, sources = np.empty(_BLOCK, np.int64), np.empty(_BLOCK, np.int64)
        for start in range(first, last, _BLOCK):
            count = min(_BLOCK, last - start)
            for k in range(count * width):
                sums[k] = bias[k % width] * _UNITS
            for child in range(CHILDREN):
                pairs = 0
                for i in range(count):
                    targets[pairs], sources[pairs] = i, slots[start + i] >> 3
                    pairs += slots[start + i] & 7 == child
                add_products(
                    sums, targets, read, sources, pairs, kernel, child * width * width,
                    width, width,
                )  # fmt: skip
            for k in range(count * width):
                feature = streamed(sums[k])
                features[start * width + k] = feature
                active[start * width + k] = activated(feature)

    return compiled(descend)

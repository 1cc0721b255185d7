"""Inference of RENO in compiled layers, which return cumulative frequencies of symbols.

Encoder and decoder agree to the last bit. The order of IEEE 754 operations does not depend on the
number of threads (see `add_products`). The exponential function, which libraries round differently,
is that of `pcc_networks.exponential`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pcc_networks.exponential import exponential
from pcc_networks.range_coder import CDF_BITS, Cumulative, Symbols
from pcc_networks.reno.weights import VALUES, Floats32, RenoWeights
from pcc_networks.sparse.thread_pool import Scratch, ThreadPool
from pcc_networks.sparse.voxels import OFFSETS, NeighbourTable
from pointkit.coding.intrinsics import add_products
from pointkit.compiling import compiled

_BLOCK_ROWS = 128
"""Number of voxels for which a layer is computed at a time: so few that their sums fit into the
processor's first-level cache."""
_ZERO = np.float32(0)
_SPREAD = float(2**CDF_BITS - VALUES)
"""Total frequency, minus 1 for each of the 16 values."""


@cache
def convolution(channels: int) -> Callable[..., None]:
    """Compile a 3x3x3 convolution with ReLU, before which a residual may be added.

    Features outside the set of voxels are zero. A sum starts with the residual; neighbours follow
    in the order of offsets, x fastest.
    """

    def convolve(
        table: NeighbourTable, features: Floats32, kernel: Floats32, residual: Floats32, first: int,
        last: int, result: Floats32,
    ) -> None:  # fmt: skip
        sums = np.empty(_BLOCK_ROWS * channels, np.float32)
        targets, sources = np.empty(_BLOCK_ROWS, np.int64), np.empty(_BLOCK_ROWS, np.int64)
        for start in range(first, last, _BLOCK_ROWS):
            count = min(_BLOCK_ROWS, last - start)
            for k in range(count * channels):
                sums[k] = residual[start * channels + k] if len(residual) > 0 else _ZERO
            for offset in range(OFFSETS):
                pairs = 0
                for i in range(count):
                    neighbour = table[offset, start + i]
                    # overwritten by the next neighbour if there is none
                    targets[pairs], sources[pairs] = i, neighbour
                    pairs += neighbour >= 0
                add_products(
                    sums, targets, features, sources, pairs, kernel, offset * channels * channels,
                    channels, channels,
                )  # fmt: skip
            for k in range(count * channels):
                result[start * channels + k] = max(sums[k], _ZERO)

    return compiled(convolve)


@cache
def head(channels: int) -> Callable[..., None]:
    """Compile the layers that predict the cumulative frequencies of a symbol from features."""

    def predict(
        features: Floats32, first: int, last: int, hidden: Floats32, hidden_bias: Floats32,
        logits: Floats32, logits_bias: Floats32, embedding: Floats32, symbols: Symbols,
        predicted: Cumulative,
    ) -> None:  # fmt: skip
        inputs, result = np.empty((2, _BLOCK_ROWS * channels), np.float32)
        sums = np.empty(_BLOCK_ROWS * VALUES, np.float32)
        all_rows = np.arange(_BLOCK_ROWS)
        for start in range(first, last, _BLOCK_ROWS):
            count = min(_BLOCK_ROWS, last - start)
            for i in range(count):
                for j in range(channels):
                    value = features[(start + i) * channels + j]
                    if len(symbols) > 0:
                        value += embedding[np.int64(symbols[start + i]) * channels + j]
                    inputs[i * channels + j] = value
                    result[i * channels + j] = hidden_bias[j]
            add_products(result, all_rows, inputs, all_rows, count, hidden, 0, channels, channels)
            for k in range(count * channels):
                inputs[k] = max(result[k], _ZERO)
            for k in range(count * VALUES):
                sums[k] = logits_bias[k % VALUES]
            add_products(sums, all_rows, inputs, all_rows, count, logits, 0, channels, VALUES)
            for i in range(count):
                cumulate(sums, i * VALUES, predicted[start + i])

    return compiled(predict)


@compiled
def cumulate(logits: Floats32, at: int, out: Cumulative) -> None:
    """Compute the cumulative frequencies of 16 logits, rounded as in the authors' program.

    The cumulative softmax is multiplied by 2^16 - 16 and rounded. Then 1 is added to the frequency
    of each value. Logits that are not finite give equal frequencies.

    Parameters
    ----------
    logits
        Array that contains the logits.
    at
        Index of the first logit.
    out
        Receives the 17 cumulative frequencies.
    """
    max_logit = np.float64(logits[at])
    for j in range(1, VALUES):
        max_logit = max(max_logit, np.float64(logits[at + j]))
    total = 0.0
    for j in range(VALUES):
        total += exponential(np.float64(logits[at + j]) - max_logit)
    cumulative = 0.0
    for j in range(VALUES):
        share = cumulative / total if total >= 1.0 and total <= VALUES else j / VALUES
        out[j] = np.int64(math.floor(share * _SPREAD + 0.5)) + j
        cumulative += exponential(np.float64(logits[at + j]) - max_logit)
    out[VALUES] = 2**CDF_BITS


Occupancy = NDArray[np.uint8]
"""(n,), bit ``x + 2 y + 4 z`` for each child of a voxel."""
_CHUNK_ROWS = 2**12
_NONE, _NO_SYMBOLS = np.empty(0, np.float32), np.empty(0, np.uint8)


def prior_features(
    weights: RenoWeights, occupancy: Occupancy, table: NeighbourTable, pool: ThreadPool
) -> Floats32:
    """Return the features of the voxels of a level, which describe their occupancy.

    Parameters
    ----------
    weights
        The network.
    occupancy
        Occupancy (n,) of the children of each voxel.
    table
        Neighbour table (27, n) of the voxels.
    pool
        Threads of the layers.

    Returns
    -------
    ndarray
        Features of all voxels, a flat array (n * channels,).
    """
    embedded = weights.occupancy_embedding.reshape(-1, weights.channels)[occupancy].ravel()
    return _residual_network(weights.prior, weights.channels, embedded, table, pool)


def target_features(
    weights: RenoWeights,
    parents: Floats32,
    slots: NDArray[np.int64],
    table: NeighbourTable,
    pool: ThreadPool,
) -> Floats32:
    """Return the features of children, computed from those of their parents.

    Parameters
    ----------
    weights
        The network.
    parents
        Features of the parents, a flat array.
    slots
        Slots (n,) of the children (see `sparse.voxels`).
    table
        Neighbour table (27, n) of the children.
    pool
        Threads of the layers.
    """
    channels = weights.channels
    embedded = weights.child_embedding.reshape(-1, channels)[slots & 7]
    embedded += parents.reshape(-1, channels)[slots >> 3]
    return _residual_network(weights.target, channels, embedded.ravel(), table, pool)


def _residual_network(
    kernels: Sequence[Floats32],
    channels: int,
    features: Floats32,
    table: NeighbourTable,
    pool: ThreadPool,
) -> Floats32:
    convolve = convolution(channels)

    def convolved(features_in: Floats32, kernel: Floats32, residual: Floats32 = _NONE) -> Floats32:
        result = np.empty_like(features_in)

        def work(rows: slice, _: Scratch) -> None:
            convolve(table, features_in, kernel, residual, rows.start, rows.stop, result)

        pool.map_chunks(table.shape[1], _CHUNK_ROWS, work)
        return result

    features = convolved(features, kernels[0])
    for conv0, conv1 in (kernels[1:3], kernels[3:5]):
        features = convolved(convolved(features, conv0), conv1, features)
    return features


def predicted(
    weights: RenoWeights,
    half: int,
    features: Floats32,
    pool: ThreadPool,
    first: Symbols = _NO_SYMBOLS,
) -> Cumulative:
    """Return the cumulative frequencies (n, 17) of symbols.

    Parameters
    ----------
    weights
        The network.
    half
        0 for first symbols, 1 for second symbols.
    features
        Features of the voxels, a flat array.
    pool
        Threads of the layers.
    first
        First symbols (n,) of the voxels, which the prediction of second symbols needs.
    """
    predict = head(weights.channels)
    rows = len(features) // weights.channels
    result = np.empty((rows, VALUES + 1), np.int32)

    def work(chunk: slice, _: Scratch) -> None:
        predict(
            features, chunk.start, chunk.stop, *weights.heads[half], weights.symbol_embedding,
            first, result,
        )  # fmt: skip

    pool.map_chunks(rows, _CHUNK_ROWS, work)
    return result

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pcc_networks.reno.layers import Cumulative, Symbols, convolution, head
from pcc_networks.reno.weights import VALUES, Floats32, RenoWeights
from pcc_networks.sparse.thread_pool import Scratch, ThreadPool
from pcc_networks.sparse.voxels import NeighbourTable

Occupancy = NDArray[np.uint8]
"""(n,), bit ``x + 2 y + 4 z`` for each child of a voxel."""
_CHUNK_ROWS = 2**12
_NONE, _NO_SYMBOLS = np.empty(0, np.float32), np.empty(0, np.uint8)


def prior_features(
    weights: RenoWeights, occupancy: Occupancy, table: NeighbourTable, pool: ThreadPool
) -> Floats32:
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

    `slots` (n,) (see `sparse.voxels`) and `table` are the children's slots and neighbour table.
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
    """Return cumulative frequencies (n, 17) of first symbols or, given `first`, of second ones."""
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

"""Inference of LiZIP, with the sums of the authors' program in C++ on processors with AVX2.

A sum has eight lanes, between which the inputs take turns. Each lane adds its products in their
order by fused multiply-adds. The lanes are added in pairs, then the products of the last inputs,
which fill no turn, and at last the sum is added to the bias. The same operations of IEEE 754 give
the same bits on every machine.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pcc_networks.lizip.weights import LANES, WIDE, Floats32, LizipWeights
from pcc_networks.sparse.thread_pool import Scratch, ThreadPool
from pointkit.coding.intrinsics import add_products
from pointkit.compiling import compiled

_BLOCK_ROWS = 32
"""Number of points for which a layer is computed at a time: so few that their partial sums fit into
the processor's first-level cache."""
_CHUNK_ROWS = 256
"""Number of rows that a thread computes at a time."""
_ZERO = np.float32(0)


@cache
def linear(inputs: int) -> Callable[..., None]:
    """Compile a linear layer with a number of inputs, after which a ReLU may follow."""
    each, left = inputs // LANES, inputs % LANES

    def compute(
        values: Floats32, rows: int, outputs: int, lanes: Floats32, rest: Floats32, bias: Floats32,
        is_last: bool, result: Floats32,
    ) -> None:  # fmt: skip
        turns = np.empty(_BLOCK_ROWS * LANES * each, np.float32)
        last = np.empty(_BLOCK_ROWS * left, np.float32)
        sums = np.empty(_BLOCK_ROWS * LANES * WIDE, np.float32)
        totals = np.empty(_BLOCK_ROWS * WIDE, np.float32)
        all_rows = np.arange(_BLOCK_ROWS)
        for start in range(0, rows, _BLOCK_ROWS):
            count = min(_BLOCK_ROWS, rows - start)
            _divide(values, start, count, inputs, turns, last)
            for chunk in range((outputs + WIDE - 1) // WIDE):
                sums[:] = _ZERO
                for lane in range(LANES):
                    at, of_lane = (chunk * LANES + lane) * each * WIDE, all_rows * LANES + lane
                    add_products(sums, of_lane, turns, of_lane, count, lanes, at, each, WIDE)
                _add_lanes(sums, count, totals)
                at = chunk * left * WIDE
                add_products(totals, all_rows, last, all_rows, count, rest, at, left, WIDE)
                _store(totals, start, count, chunk * WIDE, outputs, bias, is_last, result)

    return compiled(compute)


@compiled
def _divide(
    values: Floats32, start: int, count: int, inputs: int, turns: Floats32, last: Floats32
) -> None:
    """Copy the inputs of rows to lanes, (rows, 8, turns), and those that are left."""
    each, left = inputs // LANES, inputs % LANES
    for row in range(count):
        at = (start + row) * inputs
        for k in range(each * LANES):
            turns[(row * LANES + k % LANES) * each + k // LANES] = values[at + k]
        for k in range(left):
            last[row * left + k] = values[at + each * LANES + k]


@compiled
def _add_lanes(sums: Floats32, count: int, totals: Floats32) -> None:
    """Add the eight lanes of each sum, as AVX's horizontal additions do."""
    for row in range(count):
        for k in range(WIDE):
            at = row * LANES * WIDE + k
            even = (sums[at] + sums[at + 4 * WIDE]) + (sums[at + 2 * WIDE] + sums[at + 6 * WIDE])
            at += WIDE
            odd = (sums[at] + sums[at + 4 * WIDE]) + (sums[at + 2 * WIDE] + sums[at + 6 * WIDE])
            totals[row * WIDE + k] = even + odd


@compiled
def _store(
    totals: Floats32, start: int, count: int, first: int, outputs: int, bias: Floats32,
    is_last: bool, result: Floats32,
) -> None:  # fmt: skip
    """Add sums to the bias of the outputs from `first` on; apply the ReLU unless it is the last."""
    for row in range(count):
        for k in range(min(WIDE, outputs - first)):
            total = bias[first + k] + totals[row * WIDE + k]
            kept = is_last or total > _ZERO
            result[(start + row) * outputs + first + k] = total if kept else _ZERO


def predicted(
    weights: LizipWeights, contexts: Floats32, scale: np.float32, pool: ThreadPool
) -> NDArray[np.int32]:
    """Return the predicted points (n, 3), in steps of the grid.

    Parameters
    ----------
    weights
        The network.
    contexts
        Coordinates (n, 3 * context), m, of the points that the network reads.
    scale
        Steps of the grid in a metre.
    pool
        Threads of the layers.
    """
    result = np.empty((len(contexts), 3), np.int32)

    def work(chunk: slice, _: Scratch) -> None:
        values, rows = np.ascontiguousarray(contexts[chunk]).ravel(), chunk.stop - chunk.start
        for layer in weights.layers:
            made = np.empty(rows * layer.outputs, np.float32)
            is_last = layer is weights.layers[-1]
            linear(layer.inputs)(
                values, rows, layer.outputs, layer.lanes, layer.rest, layer.bias, is_last, made
            )
            values = made
        result[chunk] = steps_of(values.reshape(-1, 3), scale)

    pool.map_chunks(len(contexts), _CHUNK_ROWS, work)
    return result


def steps_of(points: Floats32, scale: np.float32) -> NDArray[np.int32]:
    """Multiply coordinates by a scale and round them to integers, halves away from zero.

    Products are in single precision. What exceeds 32 bits, or is not a number, becomes -2^31, as
    x86 processors convert it.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        product = points * scale
        whole = np.trunc(product)
        whole += np.copysign((np.abs(product - whole) >= 0.5).astype(np.float32), product)
        fits = (whole >= -(2.0**31)) & (whole < 2.0**31)
        return np.where(fits, whole, np.float32(-(2.0**31))).astype(np.int32)

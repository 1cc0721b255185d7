"""Inference of PoLoPCAC in fixed point, with the same result on every machine.

Sums of products are exact (see `fixed_point`). All other operations are single steps of IEEE 754 in
a fixed order, and the exponential function is computed here.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from pcc_networks.exponential import exponential
from pcc_networks.polopcac.fixed_point import (
    MOST_STEPS,
    STEP,
    STEP_BITS,
    Floats,
    add_values,
    applied,
    clipped,
    flat,
    rounded,
)
from pcc_networks.polopcac.weights import OUTPUTS, AttentionLayer, PolopcacWeights
from pcc_networks.sparse.thread_pool import Scratch, ThreadPool
from pointkit.compiling import compiled

NEIGHBOURS = 8
"""Number of coded points from which a point is predicted."""
_CHUNK_POINTS = 128
"""Number of points that a thread computes at a time, such that their features fit the second-level
cache."""
_FINE_BITS = 10
_FINE = 2**_FINE_BITS
_LARGEST_EXPONENT = 32


def predicted(
    weights: PolopcacWeights, offsets: Floats, values: Floats, pool: ThreadPool
) -> Floats:
    """Return what the network predicts of points from their neighbours.

    Parameters
    ----------
    weights
        The network.
    offsets
        Offsets (n, 8, 3) of the neighbours from the point, scaled to a unit ball, in steps.
    values
        Values (n, 8, 3) of the neighbours, from 0 to 1, in steps.
    pool
        Threads; the result does not depend on their number.

    Returns
    -------
    ndarray
        Outputs (n, 6), in steps: three that are the locations of distributions, and three that are
        the logarithms of their scales.
    """
    result = np.empty((len(offsets), OUTPUTS))
    tables = _exponentials()

    def work(rows: slice, _: Scratch) -> None:
        result[rows] = _outputs(weights, offsets[rows], values[rows], tables).numpy()

    pool.map_chunks(len(offsets), _CHUNK_POINTS, work)
    return result


def _outputs(
    weights: PolopcacWeights, offsets: Floats, values: Floats, tables: tuple[Floats, Floats]
) -> Tensor:
    places, held = (
        torch.from_numpy(each.reshape(-1, each.shape[-1])) for each in (offsets, values)
    )
    features = applied(weights.first, held)
    for layer in weights.layers:
        features = _attended(layer, features, places, tables)
    sums = features.view(len(offsets), NEIGHBOURS, weights.channels).sum(dim=1)
    outputs = sums.clamp_(-MOST_STEPS, MOST_STEPS)
    for number, linear in enumerate(weights.head, start=1):
        outputs = applied(linear, outputs, relu=number < len(weights.head))
    return outputs


def _attended(
    layer: AttentionLayer, features: Tensor, places: Tensor, tables: tuple[Floats, Floats]
) -> Tensor:
    channels = features.shape[1]
    embedded = applied(layer.embedding, features, relu=True)
    key_value = applied(layer.key_value, embedded)
    factor, summand = (
        applied(last, applied(first, places, relu=True))
        for first, last in (layer.factor, layer.summand)
    )
    _relate(flat(key_value), flat(factor), flat(summand), channels)
    hidden = applied(layer.scores[0], key_value[:, :channels], relu=True)
    scores = applied(layer.scores[1], hidden)
    _weigh(flat(scores), flat(key_value), channels, *tables)
    output = applied(layer.output, scores)
    add_values(flat(features), flat(output))
    return output


@compiled
def _relate(key_value: Floats, factor: Floats, summand: Floats, channels: int) -> None:
    for row in range(len(factor) // channels):
        for channel in range(channels):
            at, key = row * channels + channel, 2 * row * channels + channel
            product = clipped(key_value[key] * factor[at] * STEP, -MOST_STEPS)
            key_value[key] = clipped(rounded(product) + summand[at], -MOST_STEPS)
            value = key + channels
            key_value[value] = clipped(key_value[value] + summand[at], -MOST_STEPS)


@compiled
def _weigh(scores: Floats, key_value: Floats, channels: int, coarse: Floats, fine: Floats) -> None:
    """Replace scores by neighbours' values times their shares (softmax), without negative ones."""
    shares = np.empty((NEIGHBOURS, channels))
    largest, total = np.empty(channels), np.empty(channels)
    for first in range(0, len(scores), NEIGHBOURS * channels):
        largest[:] = -MOST_STEPS
        total[:] = 0.0
        for neighbour in range(NEIGHBOURS):
            for channel in range(channels):
                score = scores[first + neighbour * channels + channel]
                largest[channel] = max(largest[channel], score)
        for neighbour in range(NEIGHBOURS):
            for channel in range(channels):
                score = scores[first + neighbour * channels + channel]
                below = min(np.int64(largest[channel] - score), (len(coarse) - 1) * _FINE)
                share = coarse[below >> _FINE_BITS] * fine[below & (_FINE - 1)]
                shares[neighbour, channel] = share
                total[channel] += share
        for neighbour in range(NEIGHBOURS):
            for channel in range(channels):
                at = first + neighbour * channels + channel
                value = key_value[2 * (at - channel) + channels + channel]
                weighted = shares[neighbour, channel] / total[channel] * value
                scores[at] = rounded(max(weighted, 0.0))


def _exponentials() -> tuple[Floats, Floats]:
    """Return exponentials of negative multiples of 1,024 steps, and of the steps between them."""
    coarse = np.arange((_LARGEST_EXPONENT << STEP_BITS >> _FINE_BITS) + 1) * _FINE * STEP
    fine = np.arange(_FINE) * STEP
    return _negative_exponentials(coarse), _negative_exponentials(fine)


@compiled
def _negative_exponentials(numbers: Floats) -> Floats:
    result = np.empty(len(numbers))
    for k in range(len(numbers)):
        result[k] = exponential(-numbers[k])
    return result

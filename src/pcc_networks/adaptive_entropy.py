"""Entropy coding of a latent that adapts to the cloud.

The entropy model of a network treats the values of a latent as independent. Here, its probabilities
are mixed with those of adaptive contexts, which learn from the cloud how the latent of a voxel
depends on the latents and the occupancy of its neighbours. A value is coded as binary decisions:
zero flag, sign, and magnitude in unary.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcc_networks.entropy_bottleneck import FrequencyTable
from pcc_networks.sparse.voxels import FACES, OFFSETS, NeighbourTable
from pointkit.coding.binary_coder import (
    MAX_MEMORY,
    BitCoder,
    bit_reader,
    bit_writer,
    code_gamma,
    exhausted,
    read_to_its_end,
    written,
)
from pointkit.coding.context_mixing import Mixer, MixerOptions, code_bit, new_mixer
from pointkit.compiling import compiled_in_place
from pointkit.errors import InputError

Integers = NDArray[np.int32]
Ints = NDArray[np.int64]
_MAX_UNARY = 20
"""Magnitudes up to this value are coded in unary, larger ones in Elias gamma code."""
_MAX_MAGNITUDE = _MAX_UNARY + 2**16 - 1
_DECISIONS = 12
"""Kinds of binary decisions: zero; sign; for each sign, magnitudes 1, 2, 3, 4 and larger ones."""
_SIZES = (16 * 8, 20 * 5, 15 * 8, 4096, 64 * 6, 256 * 6, 64 * 8)
"""Numbers of contexts of the seven kinds, see `_find_contexts`."""
_EDGES, _CORNERS = (1, 3, 5, 7, 9, 11, 15, 17, 19, 21, 23, 25), (0, 2, 6, 8, 18, 20, 24, 26)
_AROUND = np.array([*FACES, *_EDGES, *_CORNERS])
"""Offsets of neighbours: at faces, then at edges, then at corners."""
_SHELLS = np.repeat(np.arange(3), [len(FACES), len(_EDGES), len(_CORNERS)])
_FIRST_OF_SHELL = np.searchsorted(_SHELLS, np.arange(3))
_SHELL_WEIGHTS = np.array([36, 9, 4])
_MAX_VALUE_BYTES = 80
"""Maximum bytes of a value; each decision takes at most log2(65,536 / 32) bits."""


class Prior(NamedTuple):
    """The distributions that the entropy model assigns to the values of a latent (n, channels).

    The frequency tables are concatenated, without their escape symbols.

    Parameters
    ----------
    lowest
        (tables,), first integer of each table.
    first
        (tables + 1,), start of each table in `below`.
    below
        For each integer of a table, the sum of the frequencies of smaller integers.
    number
        (n, channels), index of the table of each value.
    centre
        (n, channels), the value that corresponds to the integer 0 of the table.
    """

    lowest: Ints
    first: Ints
    below: Ints
    number: Integers
    centre: Integers


class _Neighbourhood(NamedTuple):
    """The neighbourhood of a voxel, in arrays that are reused for all voxels.

    Parameters
    ----------
    patterns
        (3,), bit masks of occupied neighbours at faces, edges and corners.
    rows, weights
        Rows of neighbours that are coded before the voxel (at faces first), and their weights in
        means.
    counts
        (2,), numbers of these neighbours, in total and at faces.
    contexts
        (7,), contexts of a value, without the offset of a decision.
    """

    patterns: Ints
    rows: Ints
    weights: Ints
    counts: Ints
    contexts: Ints


def prior_of(
    tables: Sequence[FrequencyTable], number: NDArray[np.integer[Any]], centre: Integers
) -> Prior:
    """Return the distributions of a latent (n, channels) from frequency tables.

    Parameters
    ----------
    tables
        The frequency tables.
    number
        Index (n, channels) of the table of each value.
    centre
        The value (n, channels) that corresponds to the integer 0 of the table.
    """
    sums = [np.cumsum((0, *table.frequencies[:-1]), dtype=np.int64) for table in tables]
    lowest = np.array([table.lowest for table in tables], np.int64)
    first = np.cumsum((0, *map(len, sums)))
    number, centre = (np.ascontiguousarray(a, np.int32) for a in (number, centre))
    return Prior(lowest, first, np.concatenate(sums), number, centre)


def factorised_prior(tables: Sequence[FrequencyTable], count: int) -> Prior:
    """Return the distributions of a latent (count, channels) that has one table per channel."""
    number = np.tile(np.arange(len(tables), dtype=np.int32), (count, 1))
    return prior_of(tables, number, np.zeros_like(number))


def encode_with_contexts(latent: Integers, neighbours: NeighbourTable, prior: Prior) -> bytes:
    """Encode a latent with adaptive contexts, and return the bytes.

    Parameters
    ----------
    latent
        Integers (n, channels), in the order of the voxels; magnitudes are clipped to 65,555.
    neighbours
        Neighbour table (27, n) of the voxels.
    prior
        Distributions of the values according to the entropy model.
    """
    values = np.clip(latent, -_MAX_MAGNITUDE, _MAX_MAGNITUDE).astype(np.int64)
    bits = bit_writer(_MAX_VALUE_BYTES * values.size + 16)
    _code(bits, values, neighbours, prior)
    return written(bits)


def decode_with_contexts(data: bytes, neighbours: NeighbourTable, prior: Prior) -> Integers:
    """Decode the latent (n, channels) that `encode_with_contexts` encoded.

    Raises InputError if the data are damaged.
    """
    values = np.zeros(prior.number.shape, np.int64)
    bits = bit_reader(data)
    _code(bits, values, neighbours, prior)
    if not read_to_its_end(bits):
        raise InputError("the stream is damaged (features)")
    return values.astype(np.int32)


def _code(bits: BitCoder, values: Ints, neighbours: NeighbourTable, prior: Prior) -> None:
    decisions = _DECISIONS * values.shape[1]
    starts = np.cumsum((0, *(decisions * size for size in _SIZES)))
    options = MixerOptions(
        experts=1,
        contexts=len(_SIZES),
        counters=int(starts[-1]),
        rows=decisions,
        weights=(0.4, *(0.15 for _ in _SIZES)),
        learning_rate=20,
        final_learning_rate=20,
        memory=MAX_MEMORY,
    )
    around = _Neighbourhood(*(np.zeros(n, np.int64) for n in (3, OFFSETS, OFFSETS, 2, len(_SIZES))))
    _code_values(new_mixer(bits, options), values, neighbours, prior, around, starts)


@compiled_in_place
def _code_values(
    mixer: Mixer, values: Ints, neighbours: NeighbourTable, prior: Prior, around: _Neighbourhood,
    starts: Ints,
) -> None:  # fmt: skip
    for row in range(len(values)):
        if exhausted(mixer.bits):
            return
        _find_neighbourhood(around, neighbours, row)
        for channel in range(values.shape[1]):
            _find_contexts(around, values, row, channel)
            values[row, channel] = _code_value(
                mixer, prior, around, starts, row, channel, values[row, channel]
            )


@compiled_in_place
def _find_neighbourhood(around: _Neighbourhood, neighbours: NeighbourTable, row: int) -> None:
    around.patterns[:] = 0
    count = 0
    for place in range(OFFSETS - 1):
        if place == len(FACES):
            around.counts[1] = count
        other, shell = neighbours[_AROUND[place], row], _SHELLS[place]
        around.patterns[shell] |= (other >= 0) << (place - _FIRST_OF_SHELL[shell])
        if 0 <= other < row:
            around.rows[count] = other
            around.weights[count] = _SHELL_WEIGHTS[shell]
            count += 1
    around.counts[0] = count


@compiled_in_place
def _find_contexts(around: _Neighbourhood, values: Ints, row: int, channel: int) -> None:
    """Compute the contexts of a value, to which the caller adds the offset of a decision.

    Occupancy includes all neighbours; means and magnitudes only those coded before the voxel. The
    contexts depend on:

    0. mean magnitude of the neighbours, and their number
    1. mean of the neighbours at faces, and the largest magnitude
    2. values in the two previous channels; sum of magnitudes in all previous channels
    3. occupancy at the edges
    4. occupancy at the faces, and the neighbours' mean
    5. occupancy at the corners, and the neighbours' mean
    6. occupancy at the faces, and the sum of context 2
    """
    mean, face, spread, largest = _neighbour_statistics(around, values, channel)
    before, last, second = 0, 0, 0
    for other in range(channel):
        before = min(before + abs(values[row, other]), 7)
    if channel >= 1:
        last = min(max(values[row, channel - 1], -2), 2) + 2
    if channel >= 2:
        second = min(max(values[row, channel - 2], -1), 1) + 1
    contexts, patterns = around.contexts, around.patterns
    contexts[0] = spread * 8 + min(around.counts[0], 7)
    contexts[1] = face * 5 + largest
    contexts[2] = (last * 3 + second) * 8 + before
    contexts[3] = patterns[1]
    contexts[4] = patterns[0] * 6 + mean
    contexts[5] = patterns[2] * 6 + mean
    contexts[6] = patterns[0] * 8 + before


@compiled_in_place
def _neighbour_statistics(
    around: _Neighbourhood, values: Ints, channel: int
) -> tuple[int, int, int, int]:
    total, face, magnitude, weight, largest = 0, 0, 0, 0, 0
    for place in range(around.counts[0]):
        value, factor = values[around.rows[place], channel], around.weights[place]
        total += factor * value
        magnitude += factor * abs(value)
        weight += factor
        largest = max(largest, abs(value))
        if place < around.counts[1]:
            face += value
    mean = _clipped_quotient(3 * total, 2 * weight, 2, 5)
    nearest = _clipped_quotient(2 * face, around.counts[1], 9, 19)
    spread = _clipped_quotient(4 * magnitude, weight, 15, 15) - 15
    return mean, nearest, spread, min(largest, 4)


@compiled_in_place
def _clipped_quotient(total: int, count: int, most: int, unknown: int) -> int:
    """Return the rounded quotient, clipped to +-most, plus `most`, or `unknown` if count is 0."""
    if count == 0:
        return unknown
    return min(max((2 * total + count) // (2 * count), -most), most) + most


@compiled_in_place
def _code_value(
    mixer: Mixer,
    prior: Prior,
    around: _Neighbourhood,
    starts: Ints,
    row: int,
    channel: int,
    value: int,
) -> int:
    decision = _DECISIONS * channel
    zero = _frequency(prior, row, channel, 0, 0)
    above = _frequency(prior, row, channel, 1, _MAX_MAGNITUDE)
    below = _frequency(prior, row, channel, -_MAX_MAGNITUDE, -1)
    if _code_decision(mixer, around, starts, decision, zero, above + below, value == 0) == 1:
        return 0
    sign = 2 * _code_decision(mixer, around, starts, decision + 1, above, below, value > 0) - 1
    rest = above if sign == 1 else below
    for size in range(1, _MAX_UNARY + 1):
        this = _frequency(prior, row, channel, sign * size, sign * size)
        rest -= this
        node = decision + 1 + min(size, 5) + (5 if sign == 1 else 0)
        if _code_decision(mixer, around, starts, node, this, rest, abs(value) == size) == 1:
            return sign * size
    return sign * (_MAX_UNARY + code_gamma(mixer.bits, abs(value) - _MAX_UNARY))


@compiled_in_place
def _frequency(prior: Prior, row: int, channel: int, first: int, last: int) -> int:
    number = prior.number[row, channel]
    start, end = prior.first[number], prior.first[number + 1] - 1
    zero = start - prior.lowest[number] - prior.centre[row, channel]
    low = min(max(zero + first, start), end)
    high = min(max(zero + last + 1, start), end)
    return int(prior.below[high] - prior.below[low])


@compiled_in_place
def _code_decision(
    mixer: Mixer, around: _Neighbourhood, starts: Ints, decision: int, yes: int, no: int, bit: int
) -> int:
    """Encode or decode a decision, given the frequencies `yes` of 1 and `no` of 0 in the tables."""
    for place in range(len(_SIZES)):
        mixer.contexts[place] = starts[place] + decision * _SIZES[place] + around.contexts[place]
    probability = min((yes << 12) // (yes + no), 4095) if yes + no > 0 else 2048
    mixer.rows[0] = decision
    mixer.inputs[0] = mixer.stretch[probability]
    return code_bit(mixer, int(bit), 0, 0)

"""Coding symbols bit by bit: the network's probabilities, mixed with what the cloud itself teaches.

The network knows scans in general, adaptive contexts know this one. Each bit of a symbol says of
one child whether it is occupied. The network's estimate and those of five contexts are mixed in the
logistic domain by weights that are learnt on the way (Mahoney 2005, "Adaptive weighing of context
models for lossless data compression"), and a table of what became of such mixtures corrects the
result. All arithmetic is on integers, so that every machine decodes the same.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.binary import (
    ENDS,
    LEAST,
    ONE,
    SLOWEST,
    BitCoder,
    bit_reader,
    bit_writer,
    code,
    learning_rates,
    logistic_tables,
)
from puckbench.codecs.octree_net.coding import Frequencies
from puckbench.codecs.octree_net.symbols import EVEN, GROUPS, ODD, VALUES, Symbols
from puckbench.codecs.sparse.voxels import OFFSETS, Table
from puckbench.compiling import compiled_in_place

Ints = NDArray[np.int64]
_FINE_BITS = 22
"""Adaptive probabilities are multiples of 2**-22."""
_NODES = VALUES - 1
"""Of the tree of a symbol's four bits."""
_KINDS = 2 * GROUPS * _NODES
"""Of bits: by group, by first or second symbol, by the bits of the symbol so far."""
_BUCKETS = 33
_SIZES = (64 * _KINDS, 7 * VALUES * _KINDS, 2 * 4 * 4 * 64, 2 * 4 * 16 * 64, 2 * GROUPS * 25 * 64)
"""Contexts of five kinds: see `_contexts`."""
_STARTS = np.cumsum((0, *_SIZES))
_INPUTS = len(_SIZES) + 2
_MOST_BYTES = 11
"""That the eight bits of a voxel take, each at most log2(65,536 / 32) bits."""
_CHILDREN = np.array([EVEN, ODD])


class Mixer(NamedTuple):
    """State of a coder: where the bytes are, and what it has learnt.

    chances, seen: (contexts,) probability of a 1 and number of bits seen. weights: (kinds, inputs).
    corrected: (kinds, buckets), probability of a 1 where the mixture was so. stretch, squash,
    rates: tables. at, inputs: workspace.
    """

    bits: BitCoder
    chances: Ints
    seen: Ints
    weights: Ints
    corrected: Ints
    stretch: Ints
    squash: Ints
    rates: Ints
    at: Ints
    inputs: Ints


class Known(NamedTuple):
    """What coder and decoder know of a level.

    neighbours: (27, n). codes: (n,) children so far, a bit each. done: (n,) whether all are known.
    """

    neighbours: Table
    codes: NDArray[np.uint8]
    done: NDArray[np.bool_]


def writer(voxels: int) -> Mixer:
    """A coder that writes the symbols of at most so many voxels."""
    return _mixer(bit_writer(_MOST_BYTES * voxels + 16))


def reader(stream: bytes) -> Mixer:
    """A coder that reads a stream."""
    return _mixer(bit_reader(stream))


def known_of(neighbours: Table) -> Known:
    """A level of which nothing is known yet."""
    count = neighbours.shape[1]
    return Known(neighbours, np.zeros(count, np.uint8), np.zeros(count, np.bool_))


def code_symbols(
    mixer: Mixer, level: Known, group: int, second: bool, rows: Ints, symbols: Symbols,
    frequencies: Frequencies,
) -> None:  # fmt: skip
    """Code the symbols (m,) of some rows of a level, or fill them in with what is read.

    frequencies: (m, 16), the network's. group: of the rows. second: or their first symbols.
    """
    _code_symbols(mixer, level, group, int(second), rows, symbols, frequencies, _CHILDREN, _STARTS)


def _mixer(bits: BitCoder) -> Mixer:
    half = 1 << _FINE_BITS - 1
    weights = np.zeros((_KINDS, _INPUTS), np.int64)
    weights[:, 0] = ONE
    stretch, squash = logistic_tables()
    steps = np.minimum(np.arange(_BUCKETS) * 128, 2 * ENDS - 1)
    return Mixer(
        bits,
        np.full(_STARTS[-1], half, np.int64),
        np.zeros(_STARTS[-1], np.int64),
        weights,
        np.tile(squash[steps] << _FINE_BITS - 16, (_KINDS, 1)),
        stretch,
        squash,
        learning_rates(),
        np.zeros(len(_SIZES), np.int64),
        np.zeros(_INPUTS, np.int64),
    )


@partial(compiled_in_place, nogil=True)
def _code_symbols(
    mixer: Mixer, level: Known, group: int, half: int, rows: Ints, symbols: Symbols,
    frequencies: Frequencies, children: Ints, starts: Ints,
) -> None:  # fmt: skip
    for i in range(len(rows)):
        row = rows[i]
        faces, crowd = _surroundings(level.neighbours, row)
        symbol, low, high, node, total = int(symbols[i]), 0, 16, 0, 0
        for value in range(16):
            total += int(frequencies[i, value])
        first = int(level.codes[row])
        for bit in range(4):
            child = children[half, 3 - bit]
            middle, upper = (low + high) >> 1, 0
            for value in range(middle, high):
                upper += int(frequencies[i, value])
            guess = mixer.stretch[(upper << 12) // total]
            kind = (2 * group + half) * 15 + node
            _contexts(mixer, level, row, child, guess, starts)
            mixer.at[0] += kind * 64 + faces
            mixer.at[1] += (kind * 16 + _first_symbol(first, half)) * 7 + crowd
            mixer.at[2] += (half * 4 + bit) * 256
            mixer.at[3] += half * 4096
            mixer.at[4] += (2 * group + half) * 1600
            found = _code_mixed(mixer, symbol >> (3 - bit) & 1, kind, guess)
            level.codes[row] |= found << child
            node = 2 * node + 1 + found
            if found == 1:
                low, total = middle, upper
            else:
                high, total = middle, total - upper
        symbols[i] = low
        level.done[row] = half == 1


@compiled_in_place
def _first_symbol(code: int, half: int) -> int:
    """The first symbol of children so far, 0 while it is coded itself."""
    return half * (code & 1 | code >> 2 & 2 | code >> 3 & 4 | code >> 3 & 8)


@compiled_in_place
def _surroundings(neighbours: Table, row: int) -> tuple[int, int]:
    """Which of the six faces have a neighbour, and how many of all 26 there are, in fours."""
    faces, crowd = 0, 0
    for offset in range(OFFSETS):
        crowd += neighbours[offset, row] >= 0
    for place in range(6):
        offset = (12, 14, 10, 16, 4, 22)[place]
        faces |= (neighbours[offset, row] >= 0) << place
    return faces, min((crowd - 1) >> 2, 6)


@compiled_in_place
def _contexts(mixer: Mixer, level: Known, row: int, child: int, guess: int, starts: Ints) -> None:
    """The contexts of a child, but for what depends on the kind of the bit.

    In their order: neighbours at the voxel's faces; its first symbol and how many neighbours it
    has; what is known of the six children that share a face with this one; of the three others
    that share an edge, too; the network's guess and the children beyond the voxel's faces.
    """
    x, y, z = 1, 3, 9
    x, y, z = (x if child & 1 else -x), (y if child & 2 else -y), (z if child & 4 else -z)
    own, beyond, inside, edges = int(level.codes[row]), 0, 0, 0
    for axis in range(3):
        inside += own >> (child ^ 1 << axis) & 1
        offset = (x, y, z)[axis]
        beyond += _state(level, level.neighbours[13 + offset, row], child ^ 1 << axis)
        across = level.neighbours[13 + x + y + z - offset, row]
        state = _state(level, across, child ^ 7 ^ 1 << axis)
        edges += 5 if state == 16 else int(state == 1)
    for place in range(5):
        mixer.at[place] = starts[place]
    mixer.at[2] += beyond * 4 + inside
    mixer.at[3] += (beyond * 4 + inside) * 16 + edges
    mixer.at[4] += (min(max((guess + 1536) >> 7, 0), 24)) * 64 + beyond


@compiled_in_place
def _state(level: Known, neighbour: int, child: int) -> int:
    """Of a neighbour's child: 16 occupied, 4 not known yet, 1 empty; 0 without a neighbour."""
    if neighbour < 0:
        return 0
    if not level.done[neighbour]:
        return 4
    return 16 if level.codes[neighbour] >> child & 1 else 1


@compiled_in_place
def _code_mixed(mixer: Mixer, bit: int, kind: int, guess: int) -> int:
    """Code a bit with the network's guess (a logit) and the contexts `mixer.at`; the bit."""
    inputs, weights = mixer.inputs, mixer.weights
    inputs[0], inputs[6] = guess, 77
    mixed = weights[kind, 0] * guess + weights[kind, 6] * 77
    for place in range(5):
        inputs[place + 1] = mixer.stretch[mixer.chances[mixer.at[place]] >> 10]
        mixed += weights[kind, place + 1] * inputs[place + 1]
    level = min(max(mixed >> 16, -ENDS), ENDS - 1) + ENDS
    chance = mixer.squash[level]
    corrected, bucket, share = mixer.corrected, level >> 7, level & 127
    left, right = corrected[kind, bucket], corrected[kind, bucket + 1]
    seen = (left * (128 - share) + right * share) >> 13
    final = min(max((chance + seen) >> 1, LEAST), ONE - LEAST)
    bit = code(mixer.bits, bit, final)
    target = bit * 4194303
    corrected[kind, bucket] += ((target - left) * (128 - share)) >> 14
    corrected[kind, bucket + 1] += ((target - right) * share) >> 14
    error = bit * ONE - chance
    for place in range(7):
        weights[kind, place] += (inputs[place] * error * 8 + (1 << 17)) >> 18
    for place in range(5):
        _learn(mixer, mixer.at[place], target)
    return bit


@compiled_in_place
def _learn(mixer: Mixer, context: int, target: int) -> None:
    seen = mixer.seen[context]
    mixer.chances[context] += ((target - mixer.chances[context]) * mixer.rates[seen]) >> 16
    if seen < SLOWEST:
        mixer.seen[context] = seen + 1

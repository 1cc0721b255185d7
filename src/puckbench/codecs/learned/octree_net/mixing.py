"""Coding symbols bit by bit: the network's probabilities, mixed with what the cloud itself teaches.

The network knows scans in general, adaptive contexts know this one. Each bit of a symbol says of
one child whether it is occupied; the network's estimate is mixed with those of contexts that see
the cells around the child. All arithmetic is on integers, so that every machine decodes the same.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.common.binary_coder import BitCoder, bit_reader, bit_writer
from puckbench.codecs.common.context_mixing import Habits, Mixer, code_mixed, mixer
from puckbench.codecs.learned.octree_net.causal_neighbourhood import CELLS, Cells, Known, count_of
from puckbench.codecs.learned.octree_net.frequencies import Frequencies
from puckbench.codecs.learned.octree_net.symbols import EVEN, GROUPS, ODD, VALUES, Symbols
from puckbench.core.compiling import compiled_in_place

Ints = NDArray[np.int64]
_NODES = VALUES - 1
"""Of the tree of a symbol's four bits."""
_KINDS = 2 * GROUPS * _NODES
"""Of bits: by group, by first or second symbol, by the bits of the symbol so far."""
_PLACES = 8
"""Of bits: by first or second symbol, by the number of the bit."""
_STATES = 27
"""Of three cells: empty, unknown or occupied."""
_NEAR = 7 * 4
"""Numbers of occupied and of unknown cells at a child's faces."""
_GUESSES = 25
"""Of the network: steps of half a unit of the logistic domain."""
_SIZES = (
    64 * _KINDS,
    7 * VALUES * _KINDS,
    _PLACES * _STATES * 8,
    2 * _NEAR * 8 * 8 * 4,
    _PLACES * _STATES * _STATES,
    _PLACES * 16 * _NEAR * 4,
    _PLACES * _STATES * _STATES * 8,
    _PLACES * _STATES * 729,
    2 * _GUESSES * _STATES * _STATES,
    _PLACES * 8,
    _PLACES * 27 * _STATES,
)
"""Contexts of eleven kinds: see `_contexts`."""
_STARTS = np.cumsum((0, *_SIZES))
_CONTEXTS = int(_STARTS[-1])
_ROWS = (_KINDS, 2 * _NEAR, _PLACES * _STATES)
"""Sets of weights: by kind, by what is known at the child's faces in numbers, and cell by cell."""
_BY_NEAR, _BY_CELLS = _ROWS[0], _ROWS[0] + _ROWS[1]
_HABITS = Habits(estimate=0.6, context=0.05, pace=5, memory=50)
"""Of short memory: noise changes with the distance."""
_MOST_BYTES = 11
"""That the eight bits of a voxel take, each at most log2(65,536 / 32) bits."""
_CHILDREN = np.array([EVEN, ODD])


def writer(voxels: int) -> Mixer:
    """A coder that writes the symbols of at most so many voxels."""
    return _mixer(bit_writer(_MOST_BYTES * voxels + 16))


def reader(stream: bytes) -> Mixer:
    """A coder that reads a stream."""
    return _mixer(bit_reader(stream))


def _mixer(bits: BitCoder) -> Mixer:
    return mixer(bits, _CONTEXTS, len(_SIZES), sum(_ROWS), len(_ROWS), _HABITS)


def code_symbols(
    mixer: Mixer, level: Known, group: int, second: bool, rows: Ints, symbols: Symbols,
    frequencies: Frequencies,
) -> None:  # fmt: skip
    """Code the symbols (m,) of some rows of a level, or fill them in with what is read.

    frequencies: (m, 16), the network's. group: of the rows, around which `look_around` has looked.
    second: or their first symbols.
    """
    _code_symbols(
        mixer, level, group, int(second), rows, symbols, frequencies, _CHILDREN, _STARTS, CELLS
    )


@compiled_in_place
def _code_symbols(
    mixer: Mixer, level: Known, group: int, half: int, rows: Ints, symbols: Symbols,
    frequencies: Frequencies, children: Ints, starts: Ints, cells: Cells,
) -> None:  # fmt: skip
    for i in range(len(rows)):
        row = rows[i]
        own = int(level.codes[row])
        occupied, unknown = level.occupied[row] | cells.occupied[13, own], level.unknown[row]
        seen = (int(level.touched[row]), min(int(level.crowd[row]) >> 2, 6))
        symbol, low, high, node, total = int(symbols[i]), 0, 16, 0, 0
        for value in range(16):
            total += frequencies[i, value]
        first = _first_symbol(own, half)
        for bit in range(4):
            child = children[half, 3 - bit]
            middle, upper = (low + high) >> 1, 0
            for value in range(middle, high):
                upper += frequencies[i, value]
            guess = mixer.stretch[(upper << 12) // total]
            kind, place = (2 * group + half) * _NODES + node, half * 4 + bit
            guessed = half * _GUESSES + min(max((guess + 1536) >> 7, 0), 24)
            _contexts(mixer, cells, starts, child, place, guessed, occupied, unknown)
            mixer.at[0] += kind * 64 + seen[0]
            mixer.at[1] += (kind * 16 + first) * 7 + seen[1]
            mixer.at[10] += int(level.spread[row]) * _STATES
            mixer.rows[0] = kind
            found = code_mixed(mixer, symbol >> (3 - bit) & 1, guess)
            own |= found << child
            occupied |= found << cells.own[child]
            node = 2 * node + 1 + found
            if found == 1:
                low, total = middle, upper
            else:
                high, total = middle, total - upper
        symbols[i] = low
        level.codes[row] = own
        level.done[row] = half == 1


@compiled_in_place
def _first_symbol(code: int, half: int) -> int:
    """The first symbol of children so far, 0 while it is coded itself."""
    return half * (code & 1 | code >> 2 & 2 | code >> 3 & 4 | code >> 3 & 8)


@compiled_in_place
def _contexts(
    mixer: Mixer, cells: Cells, starts: Ints, child: int, place: int, guessed: int,
    occupied: int, unknown: int,
) -> None:  # fmt: skip
    """The contexts of a child and its rows of weights, but for what depends on the kind of the bit.

    In their order: neighbours at the voxel's faces; its first symbol and how many neighbours it
    has; the cells at the child's faces; in numbers those at its faces, edges and corners; the cells
    at its faces outside and two steps away; in numbers those far away and near; the cells at its
    faces and at the edges outside; at its faces outside and the six beside these; what the network
    says, the cells at its faces outside and two steps away; those at its faces inside alone, which
    says how full the cloud is here; how the voxel's neighbours lie, and the cells two steps away.
    """
    half = place >> 2
    beyond, second, edges, across, inside, joined = 0, 0, 0, 0, 0, 0
    for axis in range(3):
        beyond = 3 * beyond + _state(occupied, unknown, cells.beyond[child, axis])
        second = 3 * second + _state(occupied, unknown, cells.second[child, axis])
        edges = 3 * edges + _state(occupied, unknown, cells.edges[child, axis])
        inside |= (occupied >> cells.own[child ^ 1 << axis] & 1) << axis
        joined += occupied >> cells.own[child ^ 7 ^ 1 << axis] & 1
    for side in range(6):
        across = 3 * across + _state(occupied, unknown, cells.across[child, side])
    faces, ring = count_of(occupied & cells.faces[child]), count_of(occupied & cells.ring[child])
    open_faces = count_of(unknown & cells.faces[child])
    open_ring = count_of(unknown & cells.ring[child])
    corners, far = count_of(occupied & cells.corners[child]), count_of(occupied & cells.far[child])
    near, at = faces * 4 + open_faces, place * _STATES + beyond
    numbers = (near * 8 + min(ring, 7)) * 8 + min(open_ring, 7)
    mixer.at[0], mixer.at[1] = starts[0], starts[1]
    mixer.at[2] = starts[2] + at * 8 + inside
    mixer.at[3] = starts[3] + (half * _NEAR * 64 + numbers) * 4 + min(corners, 3)
    mixer.at[4] = starts[4] + at * _STATES + second
    mixer.at[5] = starts[5] + ((place * 16 + min(far, 15)) * _NEAR + near) * 4 + joined
    mixer.at[6] = starts[6] + (at * _STATES + edges) * 8 + inside
    mixer.at[7] = starts[7] + at * 729 + across
    mixer.at[8] = starts[8] + (guessed * _STATES + beyond) * _STATES + second
    mixer.at[9] = starts[9] + place * 8 + inside
    mixer.at[10] = starts[10] + place * 27 * _STATES + second
    mixer.rows[1], mixer.rows[2] = _BY_NEAR + half * _NEAR + near, _BY_CELLS + at


@compiled_in_place
def _state(occupied: int, unknown: int, cell: int) -> int:
    """0: empty, 1: unknown, 2: occupied."""
    return (occupied >> cell & 1) << 1 | (unknown >> cell & 1)

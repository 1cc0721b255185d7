"""Coding of symbols bit by bit, with probabilities from the network and from adaptive contexts.

Each bit of a symbol says whether a child is occupied. The probability that the network gives to a
bit is mixed with those of adaptive contexts, which learn the statistics of the scan from the cells
around a voxel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcc_networks.octree_net.causal_neighbourhood import CELLS, CellMasks, LevelState
from pcc_networks.octree_net.symbols import EVEN, GROUPS, ODD, VALUES, Frequencies, Symbols
from pointkit.coding.binary_coder import BitCoder, bit_reader, bit_writer
from pointkit.coding.context_mixing import Mixer, MixerOptions, code_bit, new_mixer
from pointkit.coding.intrinsics import bit_count
from pointkit.compiling import compiled_in_place

Ints = NDArray[np.int64]
_TREE_NODES = VALUES - 1
"""Nodes of the binary tree of a symbol's four bits."""
_BIT_KINDS = 2 * GROUPS * _TREE_NODES
"""Kinds of bits: by group, symbol (first or second), and preceding bits of the symbol."""
_BIT_PLACES = 8
"""Places of bits: by symbol (first or second) and index of the bit."""
_STATES = 27
"""States of three cells, each empty, unknown or occupied."""
_FACE_COUNTS = 7 * 4
"""Combinations of the numbers of occupied (0-6) and unknown (0-3) cells at a child's faces."""
_PROBABILITY_STEPS = 25
"""Number of steps, each 1/2 wide, of the logit of the network's probability."""
_SIZES = (
    64 * _BIT_KINDS,
    7 * VALUES * _BIT_KINDS,
    _BIT_PLACES * _STATES * 8,
    2 * _FACE_COUNTS * 8 * 8 * 4,
    _BIT_PLACES * _STATES * _STATES,
    _BIT_PLACES * 16 * _FACE_COUNTS * 4,
    _BIT_PLACES * _STATES * _STATES * 8,
    _BIT_PLACES * _STATES * 729,
    2 * _PROBABILITY_STEPS * _STATES * _STATES,
    _BIT_PLACES * 8,
    _BIT_PLACES * 27 * _STATES,
)
"""Numbers of contexts of the eleven kinds, see `_find_contexts`."""
_STARTS = np.cumsum((0, *_SIZES))
_CONTEXTS = int(_STARTS[-1])
_ROWS = (_BIT_KINDS, 2 * _FACE_COUNTS, _BIT_PLACES * _STATES)
"""Rows of the three sets of weights: by the kind of bit, by the numbers of cells at the child's
faces, and by the states of cells at faces outside the voxel."""
_BY_FACE_COUNTS, _BY_CELLS = _ROWS[0], _ROWS[0] + _ROWS[1]
_MIXER = MixerOptions(
    experts=1,
    contexts=len(_SIZES),
    counters=_CONTEXTS,
    rows=sum(_ROWS),
    weights=(0.6, *(0.05 for _ in _SIZES)),
    learning_rate=5,
    final_learning_rate=5,
    memory=50,  # few bits, since noise changes with the distance
    sets=len(_ROWS),
    tables=2,
)
_MAX_VOXEL_BYTES = 11
"""Maximum bytes of a voxel: eight decisions, each of at most log2(65,536 / 32) bits."""
_CHILDREN = np.array([EVEN, ODD])


def writer(voxels: int) -> Mixer:
    """Return a coder that encodes the symbols of at most `voxels` voxels."""
    return _new_mixer(bit_writer(_MAX_VOXEL_BYTES * voxels + 16))


def reader(stream: bytes) -> Mixer:
    """Return a coder that decodes a stream."""
    return _new_mixer(bit_reader(stream))


def _new_mixer(bits: BitCoder) -> Mixer:
    return new_mixer(bits, _MIXER)


def code_symbols(
    mixer: Mixer, level: LevelState, group: int, second: bool, rows: Ints, symbols: Symbols,
    frequencies: Frequencies,
) -> None:  # fmt: skip
    """Encode the symbols of voxels of a level, or decode them in place.

    Parameters
    ----------
    mixer
        Coder from `writer` or `reader`, which decides between encoding and decoding.
    level
        State of the level; `find_neighbourhood` must have been called for the voxels.
    group
        Index of the group of the voxels.
    second
        Whether the second symbols are coded, instead of the first.
    rows
        Rows (m,) of the voxels.
    symbols
        Symbols (m,) of the voxels, to which a decoder writes.
    frequencies
        Frequencies (m, 16) that the network predicts for the values of the symbols.
    """
    _code_symbols(
        mixer, level, group, int(second), rows, symbols, frequencies, _CHILDREN, _STARTS, CELLS
    )


@compiled_in_place
def _code_symbols(
    mixer: Mixer, level: LevelState, group: int, half: int, rows: Ints, symbols: Symbols,
    frequencies: Frequencies, children: Ints, starts: Ints, cells: CellMasks,
) -> None:  # fmt: skip
    for i in range(len(rows)):
        row = rows[i]
        occupancy = int(level.codes[row])
        occupied, unknown = level.occupied[row] | cells.occupied[13, occupancy], level.unknown[row]
        around = (int(level.face_neighbours[row]), min(int(level.neighbour_counts[row]) >> 2, 6))
        symbol, low, high, node, total = int(symbols[i]), 0, 16, 0, 0
        for value in range(16):
            total += frequencies[i, value]
        first = _first_symbol(occupancy, half)
        for bit in range(4):
            child = children[half, 3 - bit]
            middle, upper = (low + high) >> 1, 0
            for value in range(middle, high):
                upper += frequencies[i, value]
            logit = mixer.stretch[(upper << 12) // total]
            kind, place = (2 * group + half) * _TREE_NODES + node, half * 4 + bit
            logit_step = half * _PROBABILITY_STEPS + min(max((logit + 1536) >> 7, 0), 24)
            _find_contexts(mixer, cells, starts, child, place, logit_step, occupied, unknown)
            mixer.contexts[0] += kind * 64 + around[0]
            mixer.contexts[1] += (kind * 16 + first) * 7 + around[1]
            mixer.contexts[10] += int(level.orientations[row]) * _STATES
            mixer.rows[0] = kind
            mixer.inputs[0] = logit
            bit_value = code_bit(mixer, symbol >> (3 - bit) & 1, 0, 0)
            occupancy |= bit_value << child
            occupied |= bit_value << cells.inner[child]
            node = 2 * node + 1 + bit_value
            if bit_value == 1:
                low, total = middle, upper
            else:
                high, total = middle, total - upper
        symbols[i] = low
        level.codes[row] = occupancy
        level.done[row] = half == 1


@compiled_in_place
def _first_symbol(code: int, half: int) -> int:
    """Return the first symbol of an occupancy, or 0 if that symbol is being coded."""
    return half * (code & 1 | code >> 2 & 2 | code >> 3 & 4 | code >> 3 & 8)


@compiled_in_place
def _find_contexts(
    mixer: Mixer, cells: CellMasks, starts: Ints, child: int, place: int, logit_step: int,
    occupied: int, unknown: int,
) -> None:  # fmt: skip
    """Compute the contexts of the bit of a voxel's child, and the rows of mixing weights.

    A cell is a place of the size of the child. Cells share a face, an edge or a corner with the
    child, and lie inside or outside its voxel. The caller adds what it knows of the voxel to
    contexts 0, 1 and 10. The contexts depend on:

    0. the voxel's neighbours at faces
    1. the voxel's first symbol and number of neighbours
    2. the cells that share a face
    3. the numbers of cells that share a face, an edge and a corner
    4. the cells outside that share a face, and the cells two steps away
    5. the numbers of cells far away, of cells that share a face, and of cells inside that share an
       edge
    6. the cells that share a face, and the cells outside that share an edge
    7. the cells outside that share a face, and six cells beside them
    8. the network's probability, and the cells of context 4
    9. the cells inside that share a face, which show the cloud's density
    10. the orientation of the voxel's neighbours, and the cells two steps away
    """
    half = place >> 2
    beyond, second, edges, across, inside, joined = 0, 0, 0, 0, 0, 0
    for axis in range(3):
        beyond = 3 * beyond + _state(occupied, unknown, cells.beyond[child, axis])
        second = 3 * second + _state(occupied, unknown, cells.second[child, axis])
        edges = 3 * edges + _state(occupied, unknown, cells.edges[child, axis])
        inside |= (occupied >> cells.inner[child ^ 1 << axis] & 1) << axis
        joined += occupied >> cells.inner[child ^ 7 ^ 1 << axis] & 1
    for side in range(6):
        across = 3 * across + _state(occupied, unknown, cells.across[child, side])
    faces, ring = bit_count(occupied & cells.faces[child]), bit_count(occupied & cells.ring[child])
    open_faces = bit_count(unknown & cells.faces[child])
    open_ring = bit_count(unknown & cells.ring[child])
    corners = bit_count(occupied & cells.corners[child])
    far = bit_count(occupied & cells.far[child])
    near, at = faces * 4 + open_faces, place * _STATES + beyond
    numbers = (near * 8 + min(ring, 7)) * 8 + min(open_ring, 7)
    mixer.contexts[0], mixer.contexts[1] = starts[0], starts[1]
    mixer.contexts[2] = starts[2] + at * 8 + inside
    mixer.contexts[3] = starts[3] + (half * _FACE_COUNTS * 64 + numbers) * 4 + min(corners, 3)
    mixer.contexts[4] = starts[4] + at * _STATES + second
    mixer.contexts[5] = starts[5] + ((place * 16 + min(far, 15)) * _FACE_COUNTS + near) * 4 + joined
    mixer.contexts[6] = starts[6] + (at * _STATES + edges) * 8 + inside
    mixer.contexts[7] = starts[7] + at * 729 + across
    mixer.contexts[8] = starts[8] + (logit_step * _STATES + beyond) * _STATES + second
    mixer.contexts[9] = starts[9] + place * 8 + inside
    mixer.contexts[10] = starts[10] + place * 27 * _STATES + second
    mixer.rows[1], mixer.rows[2] = _BY_FACE_COUNTS + half * _FACE_COUNTS + near, _BY_CELLS + at


@compiled_in_place
def _state(occupied: int, unknown: int, cell: int) -> int:
    """Return the state of a cell: 0 empty, 1 unknown, 2 occupied."""
    return (occupied >> cell & 1) << 1 | (unknown >> cell & 1)

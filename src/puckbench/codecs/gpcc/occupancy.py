"""Occupancy of a node: eight bits coded one by one, each with the model its surroundings choose."""

from __future__ import annotations

from typing import Any, NamedTuple

from puckbench.codecs.gpcc.arithmetic import code_bit, code_bypass, load, save, step
from puckbench.codecs.gpcc.compiled import integer, kernel
from puckbench.codecs.gpcc.models import OCCUPANCY, SINGLE_CHILD, Models
from puckbench.codecs.gpcc.tables import (
    ADJACENT_REDUCED,
    CODED_CHILD,
    COUNT,
    MAP_BASE,
    MAP_DELTA,
    MAP_SIZE,
)
from puckbench.core.compiling import inlined


class Surroundings(NamedTuple):
    """What the coding of an occupancy goes by.

    known: 1 when neighbours outside the parent are known, else 0. pattern: occupied neighbours.
    one, two, empty: children with at least one, at least two occupied neighbours outside the
    node, and with an unoccupied one. foretold, expected: children predicted, and those occupied.
    """

    known: int
    pattern: int
    one: int
    two: int
    empty: int
    foretold: int
    expected: int


class Planes(NamedTuple):
    """What planar coding has told of a node.

    masked_x, masked_y, masked_z: children known empty because the others' plane is known.
    possible: axes (1 x, 2 y, 4 z) not known to have both planes occupied.
    """

    masked_x: int
    masked_y: int
    masked_z: int
    possible: int


@inlined
def no_plane_known(planes: Planes) -> bool:
    """Whether no child is known empty because of planes."""
    return planes.masked_x | planes.masked_y | planes.masked_z == 0


@kernel
def code_occupancy(
    coder: Any, models: Models, around: Surroundings, planes: Planes, occupancy: int
) -> int:
    """Code which children are occupied."""
    if planes.masked_x and planes.masked_y and planes.masked_z:
        return 1 << _known_child(planes)
    if around.pattern == 0:
        single = integer(COUNT[occupancy] == 1)
        if planes.possible == 7 and code_bit(coder, models.probabilities, SINGLE_CHILD, single):
            return _code_single_child(coder, planes, occupancy)
        pair = _pair_of_children(planes)
        if pair:
            return pair
    if no_plane_known(planes) and planes.possible == 7:
        return _code_bits(coder, models, around, occupancy)
    return _code_masked_bits(coder, models, around, planes, occupancy)


@kernel
def _pair_of_children(planes: Planes) -> int:
    """The two children that two known planes leave when both are occupied; 0 without two planes."""
    child = _known_child(planes)
    if planes.masked_x and planes.masked_y:
        return 3 << child
    if planes.masked_y and planes.masked_z:
        return 0x11 << child
    if planes.masked_x and planes.masked_z:
        return 5 << child
    return 0


@kernel
def _known_child(planes: Planes) -> int:
    """The lowest child that is in every known plane."""
    return (planes.masked_x & 1) << 2 | (planes.masked_y & 1) << 1 | (planes.masked_z & 1)


@kernel
def _code_single_child(coder: Any, planes: Planes, occupancy: int) -> int:
    """Code the index of the only child, without the axes whose plane is known."""
    child = _known_child(planes)
    if planes.masked_z == 0:
        child |= code_bypass(coder, integer(occupancy & 0xAA != 0))
    if planes.masked_y == 0:
        child |= code_bypass(coder, integer(occupancy & 0xCC != 0)) << 1
    if planes.masked_x == 0:
        child |= code_bypass(coder, integer(occupancy & 0xF0 != 0)) << 2
    return 1 << child


@inlined
def _map_index(around: Surroundings, i: int, child: int, predict: bool) -> int:
    """Which of the 18 context maps the i-th coded bit, that of `child`, goes by."""
    adjacent = (around.empty >> child & 1) + 2 * (
        (around.one >> child & 1) + (around.two >> child & 1)
    )
    if i > 4:
        adjacent = ADJACENT_REDUCED[adjacent]
    if not predict:
        return 3 * adjacent
    return 3 * adjacent + (around.foretold >> child & 1) + (around.expected >> child & 1)


@inlined
def _code_mapped(coder: Any, models: Models, state: Any, place: int, bit: int) -> tuple[int, Any]:
    """Code one bit with the model that a map entry names, and move the entry."""
    entry = integer(models.maps[place])
    model = OCCUPANCY + (entry >> 3)
    bit, state, probability = step(coder, state, integer(models.probabilities[model]), bit)
    models.probabilities[model] = probability
    if bit:
        entry += MAP_DELTA[(255 - entry) >> 4]
    else:
        entry -= MAP_DELTA[entry >> 4]
    models.maps[place] = entry
    return bit, state


@kernel
def _code_bits(coder: Any, models: Models, around: Surroundings, occupancy: int) -> int:
    """Code eight bits, but those that must be ones: some child is occupied, and two when the
    node has no neighbour (one child alone was coded otherwise).
    """
    alone = around.pattern == 0
    most_zeros = 6 if alone else 7
    state = load(coder)
    coded, before, zeros = 0, 0, 0
    for i in range(8):
        child = CODED_CHILD[around.pattern, i]
        bit = 1
        if zeros < most_zeros:
            place = _map_index(around, i, child, True) * MAP_SIZE
            place += MAP_BASE[around.known, around.pattern, i] + before
            bit, state = _code_mapped(coder, models, state, place, occupancy >> child & 1)
        zeros += 1 - bit
        before += bit if alone else bit << i
        coded |= bit << child
    save(coder, state)
    return coded


@kernel
def _code_masked_bits(
    coder: Any, models: Models, around: Surroundings, planes: Planes, occupancy: int
) -> int:
    """Code the bits of the children that planar coding leaves open."""
    alone = around.pattern == 0
    masked = planes.masked_x | planes.masked_y | planes.masked_z
    zeros = masked
    state = load(coder)
    coded, before = 0, 0
    for i in range(8):
        child = CODED_CHILD[around.pattern, i]
        if masked >> child & 1:
            continue
        bit = 1
        if not _must_be_one(planes, zeros, child, alone):
            place = _map_index(around, i, child, masked == 0) * MAP_SIZE
            place += MAP_BASE[around.known, around.pattern, i] + before
            bit, state = _code_mapped(coder, models, state, place, occupancy >> child & 1)
            zeros |= (1 - bit) << child
        before += bit if alone else bit << i
        coded |= bit << child
    save(coder, state)
    return coded


@kernel
def _must_be_one(planes: Planes, zeros: int, child: int, alone: bool) -> bool:
    """Whether the children known empty leave no other choice than that this one is occupied."""
    if COUNT[zeros] >= (6 if alone else 7):
        return True
    for axis in range(3):
        mask = (planes.masked_x, planes.masked_y, planes.masked_z)[axis]
        if mask == 0 and planes.possible >> axis & 1:
            continue
        upper = (0xF0, 0xCC, 0xAA)[axis]
        half = upper if child >> (2 - axis) & 1 else upper ^ 0xFF
        most = 3 - integer(alone and mask != 0)
        if COUNT[zeros & half] >= most:
            return True
    return False

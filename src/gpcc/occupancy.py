"""Coding of a node's occupancy, bit by bit (`encodeOccupancyBitwise` of TMC13).

The context of each bit comes from one of 18 adaptive maps (`CtxMapOctreeOccupancy`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from gpcc.arithmetic import Bytes, code_bit, code_bypass, load, save, step
from gpcc.compiled import integer, kernel
from gpcc.contexts import (
    ADJACENCY_REDUCED,
    CODED_CHILD,
    CTX_MAP_BASE,
    CTX_MAP_DELTA,
    CTX_MAP_SIZE,
    CTX_OCCUPANCY,
    CTX_SINGLE_CHILD,
)
from pointkit.coding.intrinsics import bit_count
from pointkit.compiling import inlined


class OccupancyNeighbourhood(NamedTuple):
    """Neighbourhood of a node, which selects contexts of the occupancy (see `neighbours`)."""

    # Whether neighbours outside the parent are known.
    neighbours_known: int
    neigh_pattern: int
    adjacency_gt0: int
    adjacency_gt1: int
    adjacency_unocc: int
    is_predicted: int
    prediction: int


class PlanarMasks(NamedTuple):
    """Facts about a node's children that follow from the planar modes of the node."""

    # Children outside the only occupied plane along x, y and z; 0 if both planes may be occupied.
    mask_planar_x: int
    mask_planar_y: int
    mask_planar_z: int
    # Axes (1 x, 2 y, 4 z), except those along which both planes are known to be occupied.
    planar_possible: int


@inlined
def no_child_masked(masks: PlanarMasks) -> bool:
    return masks.mask_planar_x | masks.mask_planar_y | masks.mask_planar_z == 0


@kernel
def code_occupancy(
    coder: Any,
    ctx_idx_maps: Bytes,
    neighbourhood: OccupancyNeighbourhood,
    masks: PlanarMasks,
    occupancy: int,
) -> int:
    if masks.mask_planar_x and masks.mask_planar_y and masks.mask_planar_z:
        return 1 << _known_child(masks)
    if neighbourhood.neigh_pattern == 0:
        single = integer(bit_count(occupancy) == 1)
        if masks.planar_possible == 7 and code_bit(coder, CTX_SINGLE_CHILD, single):
            return _code_single_child(coder, masks, occupancy)
        pair = _pair_of_children(masks)
        if pair:
            return pair
    masked = masks.mask_planar_x | masks.mask_planar_y | masks.mask_planar_z
    if masked == 0 and masks.planar_possible == 7:
        return _code_bits(coder, ctx_idx_maps, neighbourhood, masks, 0, True, occupancy)
    return _code_bits(coder, ctx_idx_maps, neighbourhood, masks, masked, False, occupancy)


@kernel
def _pair_of_children(masks: PlanarMasks) -> int:
    """Return the mask of the two children in the only occupied planes of two axes, or 0 if none."""
    child = _known_child(masks)
    if masks.mask_planar_x and masks.mask_planar_y:
        return 3 << child
    if masks.mask_planar_y and masks.mask_planar_z:
        return 0x11 << child
    if masks.mask_planar_x and masks.mask_planar_z:
        return 5 << child
    return 0


@kernel
def _known_child(masks: PlanarMasks) -> int:
    return (
        (masks.mask_planar_x & 1) << 2 | (masks.mask_planar_y & 1) << 1 | (masks.mask_planar_z & 1)
    )


@kernel
def _code_single_child(coder: Any, masks: PlanarMasks, occupancy: int) -> int:
    child = _known_child(masks)
    if masks.mask_planar_z == 0:
        child |= code_bypass(coder, integer(occupancy & 0xAA != 0))
    if masks.mask_planar_y == 0:
        child |= code_bypass(coder, integer(occupancy & 0xCC != 0)) << 1
    if masks.mask_planar_x == 0:
        child |= code_bypass(coder, integer(occupancy & 0xF0 != 0)) << 2
    return 1 << child


@inlined
def _ctx_map_of(neighbourhood: OccupancyNeighbourhood, i: int, child: int, predict: bool) -> int:
    adjacent = (neighbourhood.adjacency_unocc >> child & 1) + 2 * (
        (neighbourhood.adjacency_gt0 >> child & 1) + (neighbourhood.adjacency_gt1 >> child & 1)
    )
    if i > 4:
        adjacent = ADJACENCY_REDUCED[adjacent]
    if not predict:
        return 3 * adjacent
    return (
        3 * adjacent
        + (neighbourhood.is_predicted >> child & 1)
        + (neighbourhood.prediction >> child & 1)
    )


@inlined
def _code_with_ctx_map(
    coder: Any, ctx_idx_maps: Bytes, state: Any, entry_index: int, bit: int
) -> tuple[int, Any]:
    entry = integer(ctx_idx_maps[entry_index])
    context = CTX_OCCUPANCY + (entry >> 3)
    bit, state, probability = step(coder, state, integer(coder.contexts[context]), bit)
    coder.contexts[context] = probability
    if bit:
        entry += CTX_MAP_DELTA[(255 - entry) >> 4]
    else:
        entry -= CTX_MAP_DELTA[entry >> 4]
    ctx_idx_maps[entry_index] = entry
    return bit, state


@inlined
def _code_bits(
    coder: Any,
    ctx_idx_maps: Bytes,
    neighbourhood: OccupancyNeighbourhood,
    masks: PlanarMasks,
    masked: int,
    free: bool,
    occupancy: int,
) -> int:
    """Encode or decode the occupancy bits of the children that are not in the mask `masked`."""
    # free: whether the planar modes do not restrict the children.
    no_neighbour = neighbourhood.neigh_pattern == 0
    # Without neighbours, a single child is coded otherwise; here, at least two are occupied.
    most_zeros = 6 if no_neighbour else 7
    state = load(coder)
    coded, coded_before, zeros, zero_count = 0, 0, masked, bit_count(masked)
    for i in range(8):
        child = CODED_CHILD[neighbourhood.neigh_pattern, i]
        if masked >> child & 1:
            continue
        bit = 1
        if zero_count < most_zeros and (
            free or not _completes_plane(masks, zeros, child, no_neighbour)
        ):
            entry_index = _ctx_map_of(neighbourhood, i, child, masked == 0) * CTX_MAP_SIZE
            entry_index += (
                CTX_MAP_BASE[neighbourhood.neighbours_known, neighbourhood.neigh_pattern, i]
                + coded_before
            )
            bit, state = _code_with_ctx_map(
                coder, ctx_idx_maps, state, entry_index, occupancy >> child & 1
            )
            zeros |= (1 - bit) << child
            zero_count += 1 - bit
        coded_before += bit if no_neighbour else bit << i
        coded |= bit << child
    save(coder, state)
    return coded


@kernel
def _completes_plane(masks: PlanarMasks, zeros: int, child: int, no_neighbour: bool) -> bool:
    """Return whether a child must be occupied because a plane would be empty without it."""
    for axis in range(3):
        mask = (masks.mask_planar_x, masks.mask_planar_y, masks.mask_planar_z)[axis]
        if mask == 0 and masks.planar_possible >> axis & 1:
            continue
        upper = (0xF0, 0xCC, 0xAA)[axis]
        half = upper if child >> (2 - axis) & 1 else upper ^ 0xFF
        most = 3 - integer(no_neighbour and mask != 0)
        if bit_count(zeros & half) >= most:
            return True
    return False

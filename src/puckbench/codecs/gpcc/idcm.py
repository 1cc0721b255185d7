"""Inferred direct coding mode (IDCM): the one or two points of an isolated node as coordinates.

See `isDirectModeEligible` and `encodePointPosition` in TMC13's geometry_octree.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.gpcc.arithmetic import code_bit, code_bypass, code_exp_golomb
from puckbench.codecs.gpcc.compiled import integer, kernel
from puckbench.codecs.gpcc.contexts import (
    CTX_DUP_POINT_CNT_EGL,
    CTX_DUP_POINT_CNT_GT0,
    CTX_DUP_POINT_CNT_GT1,
    CTX_NUM_IDCM_POINTS_GT1,
    CTX_SAME_BIT_HIGH,
    Contexts,
)
from puckbench.geometry.morton import gathered, spread

Ints = NDArray[np.int64]

MAX_POINTS = 2
_MAX_EQUAL_POINTS = 10
_ALL_AXES = 0xFFFFFFFF


class IdcmNode(NamedTuple):
    """A node whose points are coded directly.

    node_size_log2: along x, y, z. unique_points: geom_unique_points_flag. joint_2pt_idcm: whether
    the common leading bits of two points are coded once. planar_mode, plane_pos_bits: axes whose
    plane is known, and the planes.
    """

    node_size_log2: tuple[int, int, int]
    unique_points: bool
    joint_2pt_idcm: bool
    planar_mode: int
    plane_pos_bits: int


def idcm_enable_mask(mode: int, planar_enabled: bool, rate_minus1: int) -> int:
    """Which of 32 successive eligible nodes may be coded directly: a bit each."""
    if mode == 0:
        return 0
    if mode != 1 or not planar_enabled:
        return _ALL_AXES
    mask, sum_of_rates = 0, 0
    for i in range(32):
        sum_of_rates += rate_minus1 + 1
        mask |= (sum_of_rates >= 32) << i
        sum_of_rates &= 31
    return mask


@kernel
def is_idcm_eligible(
    mode: int, size_log2: int, neigh_pattern: int, sibling_count: int, child_count: int
) -> bool:
    """Whether a node's children may be coded directly.

    size_log2: of the node's longest side. neigh_pattern: its occupied face neighbours.
    sibling_count: nodes in its parent, itself included. child_count: its own.
    """
    if mode == 0 or size_log2 < 2:
        return False
    if mode == 1:
        return neigh_pattern == 0 and child_count == 1 and sibling_count <= 2
    if mode == 2:
        return neigh_pattern == 0
    return child_count > 1


@kernel
def can_be_direct(unique_points: bool, leaves: int, points: int) -> bool:
    """Whether the encoder can code a node of `leaves` distinct among `points` points directly."""
    if points > _MAX_EQUAL_POINTS:
        return False
    if leaves == 1 and points > 1 and not unique_points:
        return True
    return points <= MAX_POINTS


@kernel
def code_direct_positions(
    coder: Any,
    contexts: Contexts,
    node: IdcmNode,
    given: Ints,
    leaves: int,
    points: int,
    coded: Ints,
    bits_left: Ints,
) -> tuple[int, int]:
    """Code the points of a node; the numbers of distinct ones, and of all.

    given: (2, 3) the `leaves` distinct of `points` points to code, relative to the node. coded:
    (2, 3) those points as coded. bits_left: (3,) scratch.
    """
    pair = code_bit(coder, contexts.probabilities, CTX_NUM_IDCM_POINTS_GT1, integer(leaves == 2))
    dup_point_cnt = 0
    if not node.unique_points and not pair:
        dup_point_cnt = _code_dup_point_cnt(coder, contexts, points - 1)
    _start_from_planes(node, coded, bits_left)
    if pair and node.joint_2pt_idcm:
        _code_same_bits(coder, contexts, given, bits_left, coded)
    for i in range(1 + pair):
        for axis in range(3):
            for k in range(bits_left[axis] - 1, -1, -1):
                bit = code_bypass(coder, given[i, axis] >> k & 1)
                coded[i, axis] = coded[i, axis] << 1 | bit
    return 1 + pair, 1 + pair + dup_point_cnt


@kernel
def _code_dup_point_cnt(coder: Any, contexts: Contexts, dup_point_cnt: int) -> int:
    """Code how many further points coincide with the one point."""
    probabilities = contexts.probabilities
    if not code_bit(coder, probabilities, CTX_DUP_POINT_CNT_GT0, integer(dup_point_cnt > 0)):
        return 0
    if not code_bit(coder, probabilities, CTX_DUP_POINT_CNT_GT1, integer(dup_point_cnt > 1)):
        return 1
    return 2 + code_exp_golomb(coder, probabilities, CTX_DUP_POINT_CNT_EGL, dup_point_cnt - 2)


@kernel
def _start_from_planes(node: IdcmNode, coded: Ints, bits_left: Ints) -> None:
    """Begin both points with the bits that the planar mode gives; set how many are left."""
    for axis in range(3):
        known = node.node_size_log2[axis] > 0 and node.planar_mode >> axis & 1 != 0
        bits_left[axis] = node.node_size_log2[axis] - integer(known)
        first = (node.plane_pos_bits >> axis & 1) if known else 0
        coded[0, axis] = first
        coded[1, axis] = first


@kernel
def _code_same_bits(
    coder: Any, contexts: Contexts, given: Ints, bits_left: Ints, coded: Ints
) -> None:
    """Code two ordered points' bits along each axis up to the first that differs."""
    equal = True
    for axis in range(3):
        same = integer(1)
        ctx = 0
        while bits_left[axis] > 0 and same:
            bits_left[axis] -= 1
            one, other = (
                given[0, axis] >> bits_left[axis] & 1,
                given[1, axis] >> bits_left[axis] & 1,
            )
            same = code_bit(
                coder,
                contexts.probabilities,
                CTX_SAME_BIT_HIGH + 5 * axis + ctx,
                integer(one == other),
            )
            ctx = min(4, ctx + 1)
            bit = integer(0)
            if same or not equal:
                bit = code_bypass(coder, one)
            coded[0, axis] = coded[0, axis] << 1 | bit
            coded[1, axis] = coded[1, axis] << 1 | (bit if same else 1 - bit)
        equal = equal and same != 0


@kernel
def local_points(
    leaves: Ints, node_size_log2: tuple[int, int, int], local: Ints, ordered: bool
) -> None:
    """Split the codes of one or two leaves into coordinates within their node, into `local`.

    ordered: put the lexicographically smaller point first.
    """
    for i in range(len(leaves)):
        for axis in range(3):
            local[i, axis] = gathered(leaves[i] >> (2 - axis)) & ((1 << node_size_log2[axis]) - 1)
    if len(leaves) < 2 or not ordered:
        return
    for axis in range(3):
        if local[0, axis] != local[1, axis]:
            if local[0, axis] > local[1, axis]:
                for other in range(3):
                    local[0, other], local[1, other] = local[1, other], local[0, other]
            return


@kernel
def leaf_code(node: int, node_size_log2: tuple[int, int, int], local: Ints) -> int:
    """Morton code of the leaf at `local` (3,) within the node of code `node`."""
    code = 0
    for axis in range(3):
        whole = gathered(node >> (2 - axis)) << node_size_log2[axis] | local[axis]
        code |= spread(whole) << (2 - axis)
    return code

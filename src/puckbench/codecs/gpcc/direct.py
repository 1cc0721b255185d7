"""Inferred direct coding: the one or two points of an isolated node, coded as plain coordinates."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.gpcc.arithmetic import code_bit, code_bypass, code_exp_golomb
from puckbench.codecs.gpcc.compiled import integer, kernel
from puckbench.codecs.gpcc.models import (
    DIRECT_POINTS_GT1,
    DUPLICATES_GT0,
    DUPLICATES_GT1,
    DUPLICATES_PREFIX,
    SAME_BIT,
    Models,
)
from puckbench.geometry.morton import gathered, spread

Ints = NDArray[np.int64]

MOST_POINTS = 2
_MOST_EQUAL_POINTS = 10
_ALL_AXES = 0xFFFFFFFF


class DirectNode(NamedTuple):
    """What a direct node is coded by.

    bits: log2 of its size along x, y, z. unique: whether duplicate points were merged. joint:
    whether two points' common leading bits are coded once. planar, upper: as planar coding gave.
    """

    bits: tuple[int, int, int]
    unique: bool
    joint: bool
    planar: int
    upper: int


def enabled_mask(mode: int, planar: bool, rate_minus1: int) -> int:
    """Which of 32 successive candidate nodes may be coded directly, as bits."""
    if mode == 0:
        return 0
    if mode != 1 or not planar:
        return _ALL_AXES
    mask, sum_of_rates = 0, 0
    for i in range(32):
        sum_of_rates += rate_minus1 + 1
        mask |= (sum_of_rates >= 32) << i
        sum_of_rates &= 31
    return mask


@kernel
def is_candidate(mode: int, size: int, pattern: int, siblings: int, children: int) -> bool:
    """Whether a node's children may be coded directly.

    size: log2 of the node's longest side. pattern: its occupied neighbours. siblings: nodes in
    its parent, itself included. children: its own.
    """
    if mode == 0 or size < 2:
        return False
    if mode == 1:
        return pattern == 0 and children == 1 and siblings <= 2
    if mode == 2:
        return pattern == 0
    return children > 1


@kernel
def fits(unique: bool, leaves: int, points: int) -> bool:
    """Whether the encoder codes a node of `leaves` distinct among `points` points directly."""
    if points > _MOST_EQUAL_POINTS:
        return False
    if leaves == 1 and points > 1 and not unique:
        return True
    return points <= MOST_POINTS


@kernel
def code_direct(
    coder: Any,
    models: Models,
    node: DirectNode,
    given: Ints,
    leaves: int,
    points: int,
    coded: Ints,
    left: Ints,
) -> tuple[int, int]:
    """Code the points of a node; how many distinct ones there are, and how many in all.

    given: (2, 3) the `leaves` distinct of `points` points to code, relative to the node. coded:
    (2, 3) those points as coded. left: (3,) scratch.
    """
    pair = code_bit(coder, models.probabilities, DIRECT_POINTS_GT1, integer(leaves == 2))
    more = 0
    if not node.unique and not pair:
        more = _code_duplicates(coder, models, points - 1)
    _take_planes(node, coded, left)
    if pair and node.joint:
        _code_common_bits(coder, models, given, left, coded)
    for i in range(1 + pair):
        for axis in range(3):
            for k in range(left[axis] - 1, -1, -1):
                bit = code_bypass(coder, given[i, axis] >> k & 1)
                coded[i, axis] = coded[i, axis] << 1 | bit
    return 1 + pair, 1 + pair + more


@kernel
def _code_duplicates(coder: Any, models: Models, more: int) -> int:
    """Code how many further points stand where the one point is."""
    models_of = models.probabilities
    if not code_bit(coder, models_of, DUPLICATES_GT0, integer(more > 0)):
        return 0
    if not code_bit(coder, models_of, DUPLICATES_GT1, integer(more > 1)):
        return 1
    return 2 + code_exp_golomb(coder, models_of, DUPLICATES_PREFIX, more - 2)


@kernel
def _take_planes(node: DirectNode, coded: Ints, left: Ints) -> None:
    """Begin both points with the bits that planar coding has told; set how many are left."""
    for axis in range(3):
        known = node.bits[axis] > 0 and node.planar >> axis & 1 != 0
        left[axis] = node.bits[axis] - integer(known)
        first = (node.upper >> axis & 1) if known else 0
        coded[0, axis] = first
        coded[1, axis] = first


@kernel
def _code_common_bits(coder: Any, models: Models, given: Ints, left: Ints, coded: Ints) -> None:
    """Code two ordered points' bits along each axis as far as the first that differs."""
    equal = True
    for axis in range(3):
        same = integer(1)
        model = 0
        while left[axis] > 0 and same:
            left[axis] -= 1
            one, other = given[0, axis] >> left[axis] & 1, given[1, axis] >> left[axis] & 1
            same = code_bit(
                coder, models.probabilities, SAME_BIT + 5 * axis + model, integer(one == other)
            )
            model = min(4, model + 1)
            bit = integer(0)
            if same or not equal:
                bit = code_bypass(coder, one)
            coded[0, axis] = coded[0, axis] << 1 | bit
            coded[1, axis] = coded[1, axis] << 1 | (bit if same else 1 - bit)
        equal = equal and same != 0


@kernel
def local_points(leaves: Ints, bits: tuple[int, int, int], local: Ints, ordered: bool) -> None:
    """Split the codes of one or two leaves into coordinates within their node, into `local`.

    ordered: put the lexicographically smaller point first.
    """
    for i in range(len(leaves)):
        for axis in range(3):
            local[i, axis] = gathered(leaves[i] >> (2 - axis)) & ((1 << bits[axis]) - 1)
    if len(leaves) < 2 or not ordered:
        return
    for axis in range(3):
        if local[0, axis] != local[1, axis]:
            if local[0, axis] > local[1, axis]:
                for other in range(3):
                    local[0, other], local[1, other] = local[1, other], local[0, other]
            return


@kernel
def placed(node: int, bits: tuple[int, int, int], local: Ints) -> int:
    """Code of the leaf at `local` (3,) within the node with code `node`."""
    code = 0
    for axis in range(3):
        whole = gathered(node >> (2 - axis)) << bits[axis] | local[axis]
        code |= spread(whole) << (2 - axis)
    return code

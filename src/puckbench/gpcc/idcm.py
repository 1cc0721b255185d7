"""Inferred direct coding mode (IDCM): coordinates of a node's one or two distinct points.

In TMC13: `isDirectModeEligible`, `encodePointPosition`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import inlined
from puckbench.geometry.morton import compact_bits, spread_bits
from puckbench.gpcc.angular import (
    Angular,
    azimuth_ctx,
    corrected_elevation,
    elevation_ctx,
    laser_of,
    node_corner,
    predicted_azimuth,
    tangent_of,
)
from puckbench.gpcc.arithmetic import code_bit, code_bypass, code_exp_golomb
from puckbench.gpcc.compiled import integer, kernel
from puckbench.gpcc.contexts import (
    CTX_DUP_POINT_CNT_EGL,
    CTX_DUP_POINT_CNT_GT0,
    CTX_DUP_POINT_CNT_GT1,
    CTX_NUM_IDCM_POINTS_GT1,
    CTX_PLANE_ANGULAR_IDCM,
    CTX_PLANE_ANGULAR_PHI_IDCM,
    CTX_SAME_BIT_HIGH,
    CTX_THETA_RES,
    CTX_THETA_RES_EXP,
    CTX_THETA_RES_SIGN,
    Contexts,
)
from puckbench.gpcc.fixed_point import arc_tangent, int32, inverse_square_root

Ints = NDArray[np.int64]

MAX_POINTS = 2
_MAX_EQUAL_POINTS = 10
_ALL_AXES = 0xFFFFFFFF


class IdcmNode(NamedTuple):
    """A node coded by IDCM; `planar_mode` and `plane_pos_bits`: see `planar.planar_mode_of`."""

    morton: int
    node_size_log2: tuple[int, int, int]
    unique_points: bool
    joint_2pt_idcm: bool
    planar_mode: int
    plane_pos_bits: int


def idcm_enable_mask(mode: int, planar_enabled: bool, rate_minus1: int) -> int:
    """Return a mask: bit i is 1 if the i-th of 32 successive eligible nodes may use IDCM."""
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


@inlined
def is_idcm_eligible(
    mode: int, size_log2: int, neigh_pattern: int, sibling_count: int, child_count: int
) -> bool:
    """Return whether a node's children may use IDCM; `sibling_count` includes the node."""
    if mode == 0 or size_log2 < 2:
        return False
    if mode == 1:
        return neigh_pattern == 0 and child_count == 1 and sibling_count <= 2
    if mode == 2:
        return neigh_pattern == 0
    return child_count > 1


@inlined
def can_be_direct(unique_points: bool, leaves: int, points: int) -> bool:
    """Return whether the encoder uses IDCM for `points` points at `leaves` distinct positions."""
    if points > _MAX_EQUAL_POINTS:
        return False
    if leaves == 1 and points > 1 and not unique_points:
        return True
    return points <= MAX_POINTS


@inlined
def code_direct_positions(
    coder: Any,
    contexts: Contexts,
    node: IdcmNode,
    angular: Angular | None,
    points_in: Ints,
    leaves: int,
    points: int,
    coded: Ints,
    bits_left: Ints,
) -> tuple[int, int]:
    """Encode or decode the points of a node; return the numbers of distinct and of all points.

    points_in, coded: (2, 3) distinct points to encode, and coded points, relative to the node.
    """
    pair = code_bit(coder, contexts.probabilities, CTX_NUM_IDCM_POINTS_GT1, integer(leaves == 2))
    dup_point_cnt = 0
    if not node.unique_points and not pair:
        dup_point_cnt = _code_dup_point_cnt(coder, contexts, points - 1)
    _start_from_planes(node, coded, bits_left)
    if angular is None:
        if pair and node.joint_2pt_idcm:
            _code_same_bits(coder, contexts, points_in, bits_left, coded)
        for i in range(1 + pair):
            for axis in range(3):
                _code_axis(coder, points_in, bits_left, coded, i, axis)
    else:
        _code_by_angles(coder, contexts, node, angular, points_in, leaves, pair, coded, bits_left)
    return 1 + pair, 1 + pair + dup_point_cnt


@inlined
def _code_axis(
    coder: Any, points_in: Ints, bits_left: Ints, coded: Ints, i: int, axis: int
) -> None:
    for k in range(bits_left[axis] - 1, -1, -1):
        bit = code_bypass(coder, points_in[i, axis] >> k & 1)
        coded[i, axis] = coded[i, axis] << 1 | bit


@kernel
def _code_dup_point_cnt(coder: Any, contexts: Contexts, dup_point_cnt: int) -> int:
    probabilities = contexts.probabilities
    if not code_bit(coder, probabilities, CTX_DUP_POINT_CNT_GT0, integer(dup_point_cnt > 0)):
        return 0
    if not code_bit(coder, probabilities, CTX_DUP_POINT_CNT_GT1, integer(dup_point_cnt > 1)):
        return 1
    return 2 + code_exp_golomb(coder, probabilities, CTX_DUP_POINT_CNT_EGL, dup_point_cnt - 2)


@inlined
def _start_from_planes(node: IdcmNode, coded: Ints, bits_left: Ints) -> None:
    for axis in range(3):
        is_plane_coded = node.node_size_log2[axis] > 0 and node.planar_mode >> axis & 1 != 0
        bits_left[axis] = node.node_size_log2[axis] - integer(is_plane_coded)
        first = (node.plane_pos_bits >> axis & 1) if is_plane_coded else 0
        coded[0, axis] = first
        coded[1, axis] = first


@kernel
def _code_same_bits(
    coder: Any, contexts: Contexts, points_in: Ints, bits_left: Ints, coded: Ints
) -> None:
    equal = True
    for axis in range(3):
        same = _code_same_bits_of_axis(coder, contexts, points_in, bits_left, coded, axis, equal)
        equal = equal and same


@kernel
def _code_same_bits_of_axis(
    coder: Any,
    contexts: Contexts,
    points_in: Ints,
    bits_left: Ints,
    coded: Ints,
    axis: int,
    equal: bool,
) -> bool:
    """Encode or decode two points' common leading bits along an axis, and the first that differ.

    equal: whether the points are equal along previous axes. Returns whether all bits are equal.
    """
    same = integer(1)
    ctx = 0
    while bits_left[axis] > 0 and same:
        bits_left[axis] -= 1
        first, second = (
            points_in[0, axis] >> bits_left[axis] & 1,
            points_in[1, axis] >> bits_left[axis] & 1,
        )
        same = code_bit(
            coder,
            contexts.probabilities,
            CTX_SAME_BIT_HIGH + 5 * axis + ctx,
            integer(first == second),
        )
        ctx = min(4, ctx + 1)
        bit = integer(0)
        if same or not equal:
            bit = code_bypass(coder, first)
        coded[0, axis] = coded[0, axis] << 1 | bit
        coded[1, axis] = coded[1, axis] << 1 | (bit if same else 1 - bit)
    return same != 0


@inlined
def _code_by_angles(
    coder: Any,
    contexts: Contexts,
    node: IdcmNode,
    angular: Angular,
    points_in: Ints,
    leaves: int,
    pair: int,
    coded: Ints,
    bits_left: Ints,
) -> None:
    x, y, z = node_corner(angular, node.morton, node.node_size_log2)
    direct = integer(abs(x) <= abs(y))
    if pair and node.joint_2pt_idcm:
        _code_same_bits_of_axis(coder, contexts, points_in, bits_left, coded, direct, True)
    laser = laser_of(
        angular.elevation,
        x + _middle(coded, bits_left, 0),
        y + _middle(coded, bits_left, 1),
        z + _middle(coded, bits_left, 2),
    )
    for i in range(1 + pair):
        _code_axis(coder, points_in, bits_left, coded, i, direct)
        seen_by = laser
        if leaves:  # only an encoder has leaves
            seen_by = laser_of(
                angular.elevation, x + points_in[i, 0], y + points_in[i, 1], z + points_in[i, 2]
            )
        seen_by = laser + _code_theta_res(coder, contexts, seen_by - laser)
        if seen_by < 0 or seen_by >= len(angular.azimuth):
            angular.fault[0] = 1
            return
        direct_value = coded[i, direct] + (y if direct else x)
        angular_value = _code_azimuth(
            coder,
            contexts,
            angular,
            seen_by,
            1 - direct,
            x if direct else y,
            direct_value,
            points_in,
            coded,
            bits_left,
            i,
        )
        if bits_left[2]:
            place = (angular_value, direct_value, z) if direct else (direct_value, angular_value, z)
            _code_elevation(
                coder, contexts, angular, seen_by, place, points_in, coded, bits_left, i
            )


@inlined
def _middle(coded: Ints, bits_left: Ints, axis: int) -> int:
    left: int = bits_left[axis]
    middle: int = (coded[0, axis] << left) + (1 << left >> 1)
    return middle


@inlined
def _code_theta_res(coder: Any, contexts: Contexts, residual: int) -> int:
    probabilities = contexts.probabilities
    size = abs(residual)
    if not code_bit(coder, probabilities, CTX_THETA_RES, integer(size > 0)):
        return 0
    coded = 1 + code_bit(coder, probabilities, CTX_THETA_RES + 1, integer(size > 1))
    if coded == 2:
        coded += code_bit(coder, probabilities, CTX_THETA_RES + 2, integer(size > 2))
    if coded == 3:
        coded += code_exp_golomb(coder, probabilities, CTX_THETA_RES_EXP, size - 3, 1)
    negative = code_bit(coder, probabilities, CTX_THETA_RES_SIGN, integer(residual < 0))
    return -coded if negative else coded


@inlined
def _code_azimuth(
    coder: Any,
    contexts: Contexts,
    angular: Angular,
    laser: int,
    axis: int,
    corner: int,
    other: int,
    points_in: Ints,
    coded: Ints,
    bits_left: Ints,
    i: int,
) -> int:
    """Encode or decode a point's coordinate along `axis` (x or y), and return it.

    The result, the node's `corner` and the `other` of x and y are relative to the sensor.
    """
    left = bits_left[axis]
    place: int = corner + (coded[i, axis] << left)
    azimuth = arc_tangent(place, other) if axis else arc_tangent(other, place)
    predicted = predicted_azimuth(angular, laser, azimuth)
    for k in range(left - 1, -1, -1):
        further = place + (1 << k)
        upper = arc_tangent(further, other) if axis else arc_tangent(other, further)
        context = azimuth_ctx(azimuth - predicted, upper - predicted, 1)
        bit = code_bit(
            coder,
            contexts.probabilities,
            CTX_PLANE_ANGULAR_PHI_IDCM + context,
            points_in[i, axis] >> k & 1,
        )
        coded[i, axis] = coded[i, axis] << 1 | bit
        if bit:
            place, azimuth = further, upper
            predicted = predicted_azimuth(angular, laser, azimuth)
    angular.azimuth[laser] = azimuth
    return place


@inlined
def _code_elevation(
    coder: Any,
    contexts: Contexts,
    angular: Angular,
    laser: int,
    place: tuple[int, int, int],
    points_in: Ints,
    coded: Ints,
    bits_left: Ints,
    i: int,
) -> None:
    """Encode or decode a point's z.

    place: the point's x and y, and the node's z, relative to the sensor.
    """
    x, y, z = place
    left = bits_left[2]
    z += coded[i, 2] << left
    x, y = (x << 8) - 128, (y << 8) - 128
    root = inverse_square_root(x * x + y * y)
    elevation = corrected_elevation(angular, laser, root)
    half_height = int32(root << left >> 18)
    for k in range(left - 1, -1, -1):
        difference = int32(elevation - tangent_of((z + (1 << k) << 1) - 1, root))
        context = elevation_ctx(difference, half_height)
        bit = code_bit(
            coder,
            contexts.probabilities,
            CTX_PLANE_ANGULAR_IDCM + context,
            points_in[i, 2] >> k & 1,
        )
        coded[i, 2] = coded[i, 2] << 1 | bit
        z += bit << k
        half_height >>= 1


@kernel
def local_points(
    leaves: Ints, node_size_log2: tuple[int, int, int], local: Ints, ordered: bool
) -> None:
    """Write one or two points relative to their node to `local`, sorted if `ordered`."""
    for i in range(len(leaves)):
        for axis in range(3):
            local[i, axis] = compact_bits(leaves[i] >> (2 - axis)) & (
                (1 << node_size_log2[axis]) - 1
            )
    if len(leaves) < 2 or not ordered:
        return
    for axis in range(3):
        if local[0, axis] != local[1, axis]:
            if local[0, axis] > local[1, axis]:
                for other in range(3):
                    local[0, other], local[1, other] = local[1, other], local[0, other]
            return


@inlined
def order_by_angles(
    node: IdcmNode, angular: Angular, axes: int, second_first: bool, local: Ints
) -> None:
    """Sort a node's two points into the order in which angular mode codes them.

    Jointly coded points are sorted by x or y, whichever is coded without contexts. If these are
    equal, or points are coded separately, `second_first` swaps points of the same child node.
    """
    one_child = True
    for axis in range(3):
        top = node.node_size_log2[axis] - 1
        if axes >> (2 - axis) & 1:
            one_child = one_child and (local[0, axis] ^ local[1, axis]) >> top & 1 == 0
    swapped = one_child and second_first
    if node.joint_2pt_idcm:
        x, y, _ = node_corner(angular, node.morton, node.node_size_log2)
        direct = integer(abs(x) <= abs(y))
        if local[0, direct] != local[1, direct]:
            swapped = local[0, direct] > local[1, direct]
    if swapped:
        for axis in range(3):
            local[0, axis], local[1, axis] = local[1, axis], local[0, axis]


@inlined
def leaf_code(node: int, node_size_log2: tuple[int, int, int], local: Ints) -> int:
    code = 0
    for axis in range(3):
        whole = compact_bits(node >> (2 - axis)) << node_size_log2[axis] | local[axis]
        code |= spread_bits(whole) << (2 - axis)
    return code

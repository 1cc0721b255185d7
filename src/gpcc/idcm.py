"""Inferred direct coding mode (IDCM), which codes the coordinates of one or two distinct points.

The mode is for octree nodes that hold no other points. In TMC13: `isDirectModeEligible`,
`encodePointPosition`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gpcc.angular import (
    Angular,
    azimuth_ctx,
    corrected_elevation,
    elevation_ctx,
    laser_of,
    node_corner,
    predicted_azimuth,
    tangent_of,
)
from gpcc.arithmetic import code_bit, code_bypass, code_count, code_exp_golomb
from gpcc.compiled import integer, kernel
from gpcc.contexts import (
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
)
from gpcc.fixed_point import arc_tangent, int32, inverse_square_root
from pointkit.compiling import inlined
from pointkit.geometry.morton import Ints, compact_bits, spread_bits

MAX_POINTS = 2
_MAX_EQUAL_POINTS = 10
_ALL_AXES = 0xFFFFFFFF


class IdcmNode(NamedTuple):
    """A node whose points are coded by their coordinates, and the planes coded for it before."""

    morton: int
    node_size_log2: tuple[int, int, int]
    unique_points: bool
    joint_2pt_idcm: bool
    planar_mode: int
    plane_pos_bits: int


class LocalPoints(NamedTuple):
    """Working memory for the one or two points of a node, in coordinates relative to it."""

    # points_in, coded: (2, 3) points to encode, and coded points.
    points_in: Ints
    coded: Ints
    # (3,) number of bits to code along each axis.
    bits_left: Ints


def empty_local_points() -> LocalPoints:
    points_in, coded, bits_left = np.zeros((3, 2, 3), dtype=np.int64)
    return LocalPoints(points_in, coded, bits_left[0])


def idcm_enable_mask(mode: int, planar_enabled: bool, rate_minus1: int) -> int:
    """Return a mask of 32 bits that says which of 32 successive eligible nodes may use IDCM.

    Bit i is that of the i-th node.
    """
    if mode == 0:
        return 0
    if mode != 1 or not planar_enabled:
        return _ALL_AXES
    rate = rate_minus1 + 1
    return sum(((i + 1) * rate // 32 - i * rate // 32) << i for i in range(32))


@inlined
def is_idcm_eligible(
    mode: int, size_log2: int, neigh_pattern: int, sibling_count: int, child_count: int
) -> bool:
    """Return whether the children of a node may use IDCM; `sibling_count` includes the node."""
    if mode == 0 or size_log2 < 2:
        return False
    if mode == 1:
        return neigh_pattern == 0 and child_count == 1 and sibling_count <= 2
    if mode == 2:
        return neigh_pattern == 0
    return child_count > 1


@inlined
def can_be_direct(unique_points: bool, leaves: int, points: int) -> bool:
    """Return whether an encoder uses IDCM for a node.

    The node has `points` points at `leaves` distinct positions; `unique_points` says that the
    stream has no repeated points.
    """
    if points > _MAX_EQUAL_POINTS:
        return False
    if leaves == 1 and points > 1 and not unique_points:
        return True
    return points <= MAX_POINTS


@inlined
def code_direct_positions(
    coder: Any,
    node: IdcmNode,
    angular: Angular | None,
    local: LocalPoints,
    leaves: int,
    points: int,
) -> tuple[int, int]:
    """Encode or decode the points of a node.

    Returns
    -------
    leaves, points
        Number of distinct points, and number of all points.
    """
    pair = code_bit(coder, CTX_NUM_IDCM_POINTS_GT1, integer(leaves == 2))
    dup_point_cnt = 0
    if not node.unique_points and not pair:
        dup_point_cnt = _code_dup_point_cnt(coder, points - 1)
    _start_from_planes(node, local)
    if angular is None:
        if pair and node.joint_2pt_idcm:
            equal = True
            for axis in range(3):
                same = _code_same_bits(coder, local, axis, equal)
                equal = equal and same
        for i in range(1 + pair):
            for axis in range(3):
                _code_axis(coder, local, i, axis)
    else:
        _code_by_angles(coder, node, angular, local, leaves, pair)
    return 1 + pair, 1 + pair + dup_point_cnt


@inlined
def _code_axis(coder: Any, local: LocalPoints, i: int, axis: int) -> None:
    for k in range(local.bits_left[axis] - 1, -1, -1):
        bit = code_bypass(coder, local.points_in[i, axis] >> k & 1)
        local.coded[i, axis] = local.coded[i, axis] << 1 | bit


@kernel
def _code_dup_point_cnt(coder: Any, dup_point_cnt: int) -> int:
    if not code_bit(coder, CTX_DUP_POINT_CNT_GT0, integer(dup_point_cnt > 0)):
        return 0
    return 1 + code_count(coder, CTX_DUP_POINT_CNT_GT1, CTX_DUP_POINT_CNT_EGL, dup_point_cnt - 1)


@inlined
def _start_from_planes(node: IdcmNode, local: LocalPoints) -> None:
    for axis in range(3):
        is_plane_coded = node.node_size_log2[axis] > 0 and node.planar_mode >> axis & 1 != 0
        local.bits_left[axis] = node.node_size_log2[axis] - integer(is_plane_coded)
        first = (node.plane_pos_bits >> axis & 1) if is_plane_coded else 0
        local.coded[0, axis] = first
        local.coded[1, axis] = first


@kernel
def _code_same_bits(coder: Any, local: LocalPoints, axis: int, equal: bool) -> bool:
    """Encode or decode two points' common leading bits along an axis, and the first that differ."""
    # equal: whether the points are equal along previous axes. Returns whether all bits are equal.
    same = integer(1)
    ctx = 0
    while local.bits_left[axis] > 0 and same:
        local.bits_left[axis] -= 1
        first, second = (
            local.points_in[0, axis] >> local.bits_left[axis] & 1,
            local.points_in[1, axis] >> local.bits_left[axis] & 1,
        )
        same = code_bit(coder, CTX_SAME_BIT_HIGH + 5 * axis + ctx, integer(first == second))
        ctx = min(4, ctx + 1)
        bit = integer(0)
        if same or not equal:
            bit = code_bypass(coder, first)
        local.coded[0, axis] = local.coded[0, axis] << 1 | bit
        local.coded[1, axis] = local.coded[1, axis] << 1 | (bit if same else 1 - bit)
    return same != 0


@inlined
def _code_by_angles(
    coder: Any, node: IdcmNode, angular: Angular, local: LocalPoints, leaves: int, pair: int
) -> None:
    x, y, z = node_corner(angular, node.morton, node.node_size_log2)
    direct = integer(abs(x) <= abs(y))
    if pair and node.joint_2pt_idcm:
        _code_same_bits(coder, local, direct, True)
    laser = laser_of(
        angular.elevation, x + _middle(local, 0), y + _middle(local, 1), z + _middle(local, 2)
    )
    for i in range(1 + pair):
        _code_axis(coder, local, i, direct)
        seen_by = laser
        if leaves:  # only an encoder has leaves
            seen_by = laser_of(
                angular.elevation,
                x + local.points_in[i, 0],
                y + local.points_in[i, 1],
                z + local.points_in[i, 2],
            )
        seen_by = laser + _code_theta_res(coder, seen_by - laser)
        if seen_by < 0 or seen_by >= len(angular.azimuth):
            angular.fault[0] = 1
            return
        direct_value = local.coded[i, direct] + (y if direct else x)
        angular_value = _code_azimuth(
            coder, angular, seen_by, 1 - direct, x if direct else y, direct_value, local, i
        )
        if local.bits_left[2]:
            place = (angular_value, direct_value, z) if direct else (direct_value, angular_value, z)
            _code_elevation(coder, angular, seen_by, place, local, i)


@inlined
def _middle(local: LocalPoints, axis: int) -> int:
    left: int = local.bits_left[axis]
    middle: int = (local.coded[0, axis] << left) + (1 << left >> 1)
    return middle


@inlined
def _code_theta_res(coder: Any, residual: int) -> int:
    size = abs(residual)
    if not code_bit(coder, CTX_THETA_RES, integer(size > 0)):
        return 0
    coded = 1 + code_bit(coder, CTX_THETA_RES + 1, integer(size > 1))
    if coded == 2:
        coded += code_bit(coder, CTX_THETA_RES + 2, integer(size > 2))
    if coded == 3:
        coded += code_exp_golomb(coder, CTX_THETA_RES_EXP, size - 3, 1)
    negative = code_bit(coder, CTX_THETA_RES_SIGN, integer(residual < 0))
    return -coded if negative else coded


@inlined
def _code_azimuth(
    coder: Any,
    angular: Angular,
    laser: int,
    axis: int,
    corner: int,
    other: int,
    local: LocalPoints,
    i: int,
) -> int:
    """Encode or decode a point's coordinate along `axis` (x or y), and return the coordinate."""
    # The result, the node's `corner` and the `other` coordinate are relative to the sensor.
    left = local.bits_left[axis]
    place: int = corner + (local.coded[i, axis] << left)
    azimuth = arc_tangent(place, other) if axis else arc_tangent(other, place)
    predicted = predicted_azimuth(angular, laser, azimuth)
    for k in range(left - 1, -1, -1):
        further = place + (1 << k)
        upper = arc_tangent(further, other) if axis else arc_tangent(other, further)
        context = azimuth_ctx(azimuth - predicted, upper - predicted, 1)
        bit = code_bit(
            coder, CTX_PLANE_ANGULAR_PHI_IDCM + context, local.points_in[i, axis] >> k & 1
        )
        local.coded[i, axis] = local.coded[i, axis] << 1 | bit
        if bit:
            place, azimuth = further, upper
            predicted = predicted_azimuth(angular, laser, azimuth)
    angular.azimuth[laser] = azimuth
    return place


@inlined
def _code_elevation(
    coder: Any,
    angular: Angular,
    laser: int,
    place: tuple[int, int, int],
    local: LocalPoints,
    i: int,
) -> None:
    """Encode or decode the coordinate z of a point."""
    # place: the point's x and y, and the node's z, relative to the sensor.
    x, y, z = place
    left = local.bits_left[2]
    z += local.coded[i, 2] << left
    x, y = (x << 8) - 128, (y << 8) - 128
    root = inverse_square_root(x * x + y * y)
    elevation = corrected_elevation(angular, laser, root)
    half_height = int32(root << left >> 18)
    for k in range(left - 1, -1, -1):
        difference = int32(elevation - tangent_of((z + (1 << k) << 1) - 1, root))
        context = elevation_ctx(difference, half_height)
        bit = code_bit(coder, CTX_PLANE_ANGULAR_IDCM + context, local.points_in[i, 2] >> k & 1)
        local.coded[i, 2] = local.coded[i, 2] << 1 | bit
        z += bit << k
        half_height >>= 1


@kernel
def local_points(leaves: Ints, node_size_log2: tuple[int, int, int], points: Ints) -> None:
    """Write one or two leaves to `points`, with coordinates relative to the node."""
    for i in range(len(leaves)):
        for axis in range(3):
            inside = (1 << node_size_log2[axis]) - 1
            points[i, axis] = compact_bits(leaves[i] >> (2 - axis)) & inside


@inlined
def order_pair(
    node: IdcmNode, angular: Angular | None, axes: int, second_first: bool, points: Ints
) -> None:
    """Sort a node's two points in place into the order in which they are coded.

    Points that are coded jointly are sorted by x, y, z. In angular mode, they are sorted only by x
    or y, whichever is coded without contexts. In angular mode, points that are equal in this
    coordinate, or are coded separately, are swapped if `second_first` and both are in the same
    child node.
    """
    swapped = False
    if angular is None:
        for axis in range(2, -1, -1):
            if node.joint_2pt_idcm and points[0, axis] != points[1, axis]:
                swapped = points[0, axis] > points[1, axis]
    else:
        swapped = second_first
        for axis in range(3):
            top = node.node_size_log2[axis] - 1
            if axes >> (2 - axis) & 1 and (points[0, axis] ^ points[1, axis]) >> top & 1:
                swapped = False
        if node.joint_2pt_idcm:
            x, y, _ = node_corner(angular, node.morton, node.node_size_log2)
            direct = integer(abs(x) <= abs(y))
            if points[0, direct] != points[1, direct]:
                swapped = points[0, direct] > points[1, direct]
    if swapped:
        for axis in range(3):
            points[0, axis], points[1, axis] = points[1, axis], points[0, axis]


@inlined
def leaf_code(node: int, node_size_log2: tuple[int, int, int], point: Ints) -> int:
    code = 0
    for axis in range(3):
        whole = compact_bits(node >> (2 - axis)) << node_size_log2[axis] | point[axis]
        code |= spread_bits(whole) << (2 - axis)
    return code

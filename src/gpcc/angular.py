"""Angular mode, which derives contexts of octree nodes from the lasers of a spinning sensor.

A laser's elevation predicts which half of a node is occupied along z; the azimuth of the laser's
last shot predicts the half along x or y (`determineContextAngleForPlanar`, `findLaser`,
`AzimuthalPhiZi` in TMC13). Units are 2^-18 for tangents of elevations, 1/8 coding unit for heights,
2^-20 radians for azimuths, and 2^-32 for inverse distances.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gpcc.compiled import integer, kernel
from gpcc.fixed_point import TURN, arc_tangent, int32, inverse_square_root
from pointkit.compiling import inlined
from pointkit.errors import InputError
from pointkit.geometry.morton import Ints, compact_bits

NO_LASER = 255
"""Index in place of a laser's, for nodes too large to be assigned to one laser."""
FARTHEST = 1 << 22
"""Largest coordinate of the sensor relative to a slice's origin, beyond which TMC13 overflows."""

_NO_AZIMUTH = -(1 << 31)
_LARGEST_GAP = 128 << 18


class Angular(NamedTuple):
    """State of a sensor's lasers while a slice is coded: directions, and last shots."""

    origin: Ints
    elevation: Ints
    # Negated heights of the lasers (`syntax.Laser.z`).
    height: Ints
    # Smallest difference between two lasers' elevations.
    least_gap: int
    # step, steps: azimuth between two shots of each laser, and its inverse in units of 2^-30.
    step: Ints
    steps: Ints
    # Azimuth of each laser's last shot.
    azimuth: Ints
    # (1,) nonzero if a stream's laser index is out of range.
    fault: Ints


class PlaneAngles(NamedTuple):
    """Contexts of a node's planes along x, y and z, and the laser that sees the node.

    A context is -1 where angular mode gives none.
    """

    x: int
    y: int
    z: int
    laser: int


def angular_state(elevation: Ints, height: Ints, turns: Ints, origin: Ints) -> Angular:
    if np.abs(origin).max() > FARTHEST:
        raise InputError(f"G-PCC: the sensor is more than {FARTHEST} units away from a slice")
    if turns.min() < 1:
        raise InputError("G-PCC: a laser of the sensor does not fire in a turn")
    gaps = np.abs(np.diff(elevation))
    return Angular(
        origin=origin,
        elevation=elevation,
        height=height,
        least_gap=int(gaps.min(initial=_LARGEST_GAP)),
        step=TURN // turns,
        steps=(turns << 30) // TURN,
        azimuth=np.full(len(turns), _NO_AZIMUTH, dtype=np.int64),
        fault=np.zeros(1, dtype=np.int64),
    )


@inlined
def tangent_of(height: int, root: int) -> int:
    """Return the tangent of a point's elevation.

    Parameters
    ----------
    height
        Twice the height of the point.
    root
        Inverse distance of the point from the axis.
    """
    product = height * root
    return int32(product >> 15 if product >= 0 else -(-product >> 15))


@inlined
def corrected_elevation(angular: Angular, laser: int, root: int) -> int:
    """Return the tangent of a beam's elevation, seen from `origin`, at the distance 1 / `root`."""
    product = angular.height[laser] * root
    shift = -(product >> 17) if product >= 0 else -product >> 17
    return int32(angular.elevation[laser] + shift)


@inlined
def _nearest_laser(elevation: Ints, tangent: int) -> int:
    first, count = 1, len(elevation) - 2
    while count > 0:
        half = count >> 1
        if tangent < elevation[first + half]:
            count = half
        else:
            first += half + 1
            count -= half + 1
    below, above = elevation[first - 1], elevation[first]
    return first - 1 if int32(tangent - below) <= int32(above - tangent) else first


@kernel
def laser_of(elevation: Ints, x: int, y: int, z: int) -> int:
    if len(elevation) == 1:
        return 0
    x, y = x << 8, y << 8
    return _nearest_laser(elevation, int32(z * inverse_square_root(x * x + y * y) >> 14))


@inlined
def predicted_azimuth(angular: Angular, laser: int, azimuth: int) -> int:
    """Return the azimuth of a shot that is nearest to `azimuth`.

    Shots are extrapolated from the last shot of the laser.
    """
    last = angular.azimuth[laser]
    if last == _NO_AZIMUTH:
        return azimuth
    shots = int32((last - azimuth) * angular.steps[laser] + (1 << 29) >> 30)
    return int32(last - angular.step[laser] * shots)


@inlined
def azimuth_ctx(left: int, right: int, contrast: int) -> int:
    """Return the context of the bit that states the occupied half of a node along x or y.

    Parameters
    ----------
    left, right
        Azimuths of the two halves relative to the predicted azimuth, in units of 2^-20 radians.
    contrast
        Log2 of the ratio of `left` and `right` above which the nearer half is a safe guess.
    """
    context = 2 if (left >= 0) == (right >= 0) else 0
    left, right = abs(left), abs(right)
    if left > right:
        context += 1
        left, right = right, left
    return context + 4 if right > left << contrast else context


@inlined
def elevation_ctx(difference: int, half_height: int) -> int:
    """Return the context of the bit that states the occupied half of a node along z.

    Parameters
    ----------
    difference
        Tangent of the laser's elevation minus that of the node's middle, in units of 2^-18.
    half_height
        Half the node's height, as a difference of such tangents.
    """
    context = 0 if difference >= 0 else 1
    if int32(difference - half_height) >= 0 or int32(difference + half_height) < 0:
        context += 2
    return context


@inlined
def node_corner(
    angular: Angular, morton: int, node_size_log2: tuple[int, int, int]
) -> tuple[int, int, int]:
    return (
        (compact_bits(morton >> 2) << node_size_log2[0]) - angular.origin[0],
        (compact_bits(morton >> 1) << node_size_log2[1]) - angular.origin[1],
        (compact_bits(morton) << node_size_log2[2]) - angular.origin[2],
    )


@inlined
def plane_angles(
    angular: Angular, morton: int, node_size_log2: tuple[int, int, int], laser: int
) -> PlaneAngles:
    size_x, size_y, size_z = node_size_log2
    x, y, z = node_corner(angular, morton, node_size_log2)
    middle_x, middle_y = x + (1 << size_x >> 1), y + (1 << size_y >> 1)
    half_z = 1 << size_z >> 1
    lasers = len(angular.elevation)

    far_x, far_y = abs((middle_x << 8) - 128), abs((middle_y << 8) - 128)
    gap = angular.least_gap * (far_x + far_y >> 1)
    if lasers > 1 and gap <= half_z << 26:
        return PlaneAngles(-1, -1, -1, laser)
    root = inverse_square_root(far_x * far_x + far_y * far_y)
    tangent = tangent_of((z + half_z << 1) - 1, root)
    nearest = 0
    if lasers > 1:
        nearest = laser
        if laser == NO_LASER or gap <= half_z << 28:
            nearest = _nearest_laser(angular.elevation, tangent)
            laser = nearest & 0xFF

    middle = arc_tangent(middle_y, middle_x)
    predicted = predicted_azimuth(angular, nearest, middle)
    across = azimuth_ctx(arc_tangent(y, x) - predicted, middle - predicted, 2)
    difference = int32(corrected_elevation(angular, nearest, root) - tangent)
    up = elevation_ctx(difference, root << size_z >> 20)
    if abs(x) <= abs(y):
        return PlaneAngles(across, -1, up, laser)
    return PlaneAngles(-1, across, up, laser)


@inlined
def angular_eligible_axes(angles: PlaneAngles, eligible_axes: int, axes: int) -> int:
    """Return the mask of the axes (1 x, 2 y, 4 z) along which a node's planes are coded.

    These are the axes with an angular context, and z if it is in `eligible_axes`. Axes along which
    the node is not split are excluded; `axes` is the mask of split axes (4 x, 2 y, 1 z).
    """
    result = eligible_axes & 4
    result |= integer(angles.x >= 0) | integer(angles.y >= 0) << 1 | integer(angles.z >= 0) << 2
    return result & ((axes >> 2 & 1) | (axes & 2) | (axes & 1) << 2)

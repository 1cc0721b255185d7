"""Morton codes of whole numbers, whose bits interleave those of x, y and z.

The bit of x is the highest of each three, and an axis has up to 21 bits. Codecs write these codes
in streams. By contrast, `pointkit.geometry.spatial_order` sorts points of any coordinates in
memory; its keys have x lowest and 16 bits per axis.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled, inlined

Ints = NDArray[np.int64]

MOST_BITS = 21
X_BITS = 0x4924924924924924
Y_BITS = X_BITS >> 1
Z_BITS = X_BITS >> 2

# The bits of the axes of each mask (4 x, 2 y, 1 z) in a code.
AXES_BITS = np.array(
    [
        (X_BITS if a & 4 else 0) | (Y_BITS if a & 2 else 0) | (Z_BITS if a & 1 else 0)
        for a in range(8)
    ],
    dtype=np.int64,
)


@inlined
def first_child_code(morton: int, axes: int) -> int:
    """Return the Morton code of a node's first child in an octree.

    Parameters
    ----------
    morton
        Code of the node.
    axes
        Bit mask of the axes that this level of the octree splits: 4 for x, 2 for y, 1 for z.
    """
    if axes == 7:
        return morton << 3
    split: int = AXES_BITS[axes]
    return (morton & split) << 3 | morton & ~split


@inlined
def parent_code(morton: int, axes: int) -> int:
    """Return the Morton code of a first child's parent; this inverts `first_child_code`."""
    if axes == 7:
        return morton >> 3
    split: int = AXES_BITS[axes]
    return (morton & split) >> 3 | morton & ~split


@inlined
def compact_bits(bits: int) -> int:
    """Move every third bit, starting with the lowest, to adjacent positions."""
    bits &= Z_BITS
    bits = (bits | bits >> 2) & 0x10C30C30C30C30C3
    bits = (bits | bits >> 4) & 0x100F00F00F00F00F
    bits = (bits | bits >> 8) & 0x001F0000FF0000FF
    bits = (bits | bits >> 16) & 0x001F00000000FFFF
    return (bits | bits >> 32) & 0x1FFFFF


@inlined
def spread_bits(bits: int) -> int:
    """Move adjacent bits to every third position; this inverts `compact_bits`."""
    bits = (bits | bits << 32) & 0x001F00000000FFFF
    bits = (bits | bits << 16) & 0x001F0000FF0000FF
    bits = (bits | bits << 8) & 0x100F00F00F00F00F
    bits = (bits | bits << 4) & 0x10C30C30C30C30C3
    return (bits | bits << 2) & Z_BITS


@compiled
def morton_codes(points: Ints, axes: Ints) -> Ints:
    """Return the Morton codes (n,) of points.

    Parameters
    ----------
    points
        Points (n, 3) with whole coordinates in [0, 2^21).
    axes
        Axis (0 x, 1 y, 2 z) of each of the three columns.
    """
    codes = np.empty(len(points), dtype=np.int64)
    shifts = 2 - axes
    for i in range(len(points)):
        code = 0
        for c in range(3):
            code |= spread_bits(points[i, c]) << shifts[c]
        codes[i] = code
    return codes


@compiled
def morton_points(codes: Ints, axes: Ints, origin: Ints) -> Ints:
    """Return the points (n, 3) of Morton codes (n,), shifted by an origin (3,).

    Parameters
    ----------
    axes
        Axis (0 x, 1 y, 2 z) of each of the three columns of the result.
    """
    points = np.empty((len(codes), 3), dtype=np.int64)
    shifts = 2 - axes
    for i in range(len(codes)):
        for c in range(3):
            points[i, c] = compact_bits(codes[i] >> shifts[c]) + origin[c]
    return points

"""Morton codes: the bits of x, y and z interleaved, x highest, up to 21 bits an axis.

Within an octree a node's code is its position at its own level, so a child's code is its parent's
shifted by the axes that the level splits, and the child's index below.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled, inlined

Ints = NDArray[np.int64]

MOST_BITS = 21
X_BITS = 0x4924924924924924
Y_BITS = X_BITS >> 1
Z_BITS = X_BITS >> 2

# By a mask of axes (4 x, 2 y, 1 z): the bits of those axes in a code.
AXES_BITS = np.array(
    [
        (X_BITS if a & 4 else 0) | (Y_BITS if a & 2 else 0) | (Z_BITS if a & 1 else 0)
        for a in range(8)
    ],
    dtype=np.int64,
)


@inlined
def first_child_code(morton: int, axes: int) -> int:
    """Code of the first child of the node `morton` where `axes` are split."""
    if axes == 7:
        return morton << 3
    split: int = AXES_BITS[axes]
    return (morton & split) << 3 | morton & ~split


@inlined
def parent_code(morton: int, axes: int) -> int:
    """Code of the parent of the first child `morton` where `axes` are split."""
    if axes == 7:
        return morton >> 3
    split: int = AXES_BITS[axes]
    return (morton & split) >> 3 | morton & ~split


@inlined
def compact_bits(bits: int) -> int:
    """Every third bit, from the lowest, side by side."""
    bits &= Z_BITS
    bits = (bits | bits >> 2) & 0x10C30C30C30C30C3
    bits = (bits | bits >> 4) & 0x100F00F00F00F00F
    bits = (bits | bits >> 8) & 0x001F0000FF0000FF
    bits = (bits | bits >> 16) & 0x001F00000000FFFF
    return (bits | bits >> 32) & 0x1FFFFF


@inlined
def spread_bits(bits: int) -> int:
    """The inverse of `gathered`: bits at every third place."""
    bits = (bits | bits << 32) & 0x001F00000000FFFF
    bits = (bits | bits << 16) & 0x001F0000FF0000FF
    bits = (bits | bits << 8) & 0x100F00F00F00F00F
    bits = (bits | bits << 4) & 0x10C30C30C30C30C3
    return (bits | bits << 2) & Z_BITS


@compiled
def morton_codes(points: Ints, axes: Ints) -> Ints:
    """Codes (n,) of points (n, 3) in [0, 2**21): column c is the axis axes[c] (0 x, 1 y, 2 z)."""
    found = np.empty(len(points), dtype=np.int64)
    shifts = 2 - axes
    for i in range(len(points)):
        code = 0
        for c in range(3):
            code |= spread_bits(points[i, c]) << shifts[c]
        found[i] = code
    return found


@compiled
def morton_points(morton: Ints, axes: Ints, origin: Ints) -> Ints:
    """Points (n, 3) of codes (n,): the inverse of `codes`, plus `origin` (3,)."""
    points = np.empty((len(morton), 3), dtype=np.int64)
    shifts = 2 - axes
    for i in range(len(morton)):
        code = morton[i]
        for c in range(3):
            points[i, c] = compact_bits(code >> shifts[c]) + origin[c]
    return points

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcc.angular import laser_of
from gpcc.attributes.neighbour_search import SortedPoints
from gpcc.compiled import entry, integer
from gpcc.fixed_point import HALF_TURN, arc_tangent, square_root
from gpcc.kd_tree import Int32s
from pointkit.errors import InputError
from pointkit.geometry.morton import MOST_BITS, Ints, morton_codes

_AXES = np.arange(3)
_SPARE_BITS = 3
"""Number of additional bits of radius and azimuth, which Morton codes ignore."""


def laser_coordinates(positions: Int32s, origin: Sequence[int], elevation: Ints) -> Int32s:
    """Return radius, azimuth and laser (n, 3) of positions (n, 3), as in TMC13.

    origin: the sensor's position.
    elevation: see `angular.Angular`.
    """
    result = np.empty_like(positions)
    _convert(positions, np.array(origin, dtype=np.int64), elevation, result)
    return result


@entry
def _convert(positions: Int32s, origin: Ints, elevation: Ints, result: Int32s) -> None:
    for i in range(len(positions)):
        x = integer(positions[i, 0]) - origin[0]
        y = integer(positions[i, 1]) - origin[1]
        z = integer(positions[i, 2]) - origin[2]
        result[i, 2] = laser_of(elevation, x, y, z)
        x, y = x << 8, y << 8
        result[i, 0] = square_root(x * x + y * y) >> 8
        result[i, 1] = (arc_tangent(y, x) + HALF_TURN) >> 8


def scaled_coordinates(positions: Int32s, scale: Sequence[int]) -> Int32s:
    """Subtract the minimum from positions (n, 3); multiply the result by scale / 256."""
    wide = positions.astype(np.int64)
    wide = (wide - wide.min(axis=0)) * np.array(scale, dtype=np.int64) + 128 >> 8
    if wide.max() >= 1 << MOST_BITS + _SPARE_BITS or wide[:, 2].max() >= 1 << MOST_BITS:
        raise InputError(f"G-PCC: spherical coordinates of more than {MOST_BITS} bits")
    scaled: Int32s = wide.astype(np.int32)
    return scaled


def sorted_points(positions: Int32s, codes: Ints | None = None) -> SortedPoints:
    codes = morton_codes(positions.astype(np.int64), _AXES) if codes is None else codes
    order = np.argsort(codes, kind="stable")
    return SortedPoints(codes[order], positions[order], order.astype(np.int32))

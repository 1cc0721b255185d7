from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gpcc import syntax
from gpcc.angular import laser_of
from gpcc.attributes.levels import Levels, levels_of_detail
from gpcc.attributes.neighbour_search import SortedPoints
from gpcc.attributes.syntax import PREDICTING, AttributeHeader, AttributeParameterSet
from gpcc.compiled import entry, row
from gpcc.fixed_point import HALF_TURN, arc_tangent, square_root
from gpcc.kd_tree import Int32s
from gpcc.syntax import GeometryParameterSet, Three
from pointkit.errors import InputError
from pointkit.geometry.morton import MOST_BITS, Ints, morton_codes

_AXES = np.arange(3)
_SPARE_BITS = 3
"""Number of additional bits of radius and azimuth, which Morton codes ignore."""


@dataclass
class SlicePoints:
    """Points of a slice in coded order, for the coding of attributes.

    Coordinates are relative to the slice's origin, along the coded axes. Orders and levels of
    detail that several attributes need are computed once.
    """

    gps: GeometryParameterSet
    # Indices of x, y, z among the coded axes.
    axes: Three
    sensor: Three
    positions: Int32s
    # Morton codes (n,) of `positions`, or None.
    codes: Ints | None = None
    # Radius, azimuth and laser (n, 3) from predictive geometry, or None.
    spherical: Int32s | None = None
    _coordinates: dict[tuple[int, ...], Int32s] = field(default_factory=dict)
    _sorted: dict[tuple[int, ...], SortedPoints] = field(default_factory=dict)
    _levels: tuple[Hashable, Levels] | None = None

    def coordinates(self, aps: AttributeParameterSet) -> Int32s:
        """Return the coordinates (n, 3) in which an attribute's distances are measured.

        These are x, y and z, or the sensor's coordinates.
        """
        if not aps.spherical_coord_flag:
            return self.positions
        scale = tuple(aps.attr_coord_scale)
        if scale not in self._coordinates:
            self._coordinates[scale] = scaled_coordinates(self.laser_coordinates(), scale)
        return self._coordinates[scale]

    def laser_coordinates(self) -> Int32s:
        if not self.gps.lasers:
            raise InputError("G-PCC stream: spherical coordinates without a sensor")
        if self.gps.geom_tree_type == syntax.PREDICTIVE and self.spherical is not None:
            return self.spherical
        elevation = np.array([laser.theta for laser in self.gps.lasers], dtype=np.int64)
        return laser_coordinates(self.positions, self.sensor, elevation)

    def in_morton_order(self, aps: AttributeParameterSet) -> SortedPoints:
        scale = tuple(aps.attr_coord_scale) if aps.spherical_coord_flag else ()
        if scale not in self._sorted:
            codes = None if scale else self.codes
            self._sorted[scale] = sorted_points(self.coordinates(aps), codes)
        return self._sorted[scale]

    def levels(self, aps: AttributeParameterSet, header: AttributeHeader) -> Levels:
        """Return the levels of detail in which an attribute is coded."""
        # As in TMC13, an attribute also reuses levels from other coordinates than its own.
        key = (
            aps.num_pred_nearest_neighbours_minus1,
            aps.inter_lod_search_range,
            aps.intra_lod_search_range,
            aps.max_detail_levels,
            aps.lod_neigh_bias,
            aps.scalable_lifting_enabled_flag,
            aps.max_neigh_range_minus1,
            aps.lod_decimation_type,
            aps.dist2 + header.attr_dist2_delta,
            tuple(aps.lod_sampling_period),
            aps.intra_lod_prediction_skip_layers,
            aps.canonical_point_order_flag,
            aps.attr_encoding == PREDICTING and aps.pred_weight_blending_enabled_flag,
        )
        scalable = bool(aps.scalable_lifting_enabled_flag)
        if self._levels is None or self._levels[0] != key or scalable:
            if aps.canonical_point_order_flag:
                coordinates = self.coordinates(aps)
                indices = np.arange(len(coordinates), dtype=np.int32)
                points = SortedPoints(np.zeros(len(indices), np.int64), coordinates, indices)
            else:
                points = self.in_morton_order(aps)
            bias = np.empty(3, dtype=np.int64)
            bias[list(self.axes)] = aps.lod_neigh_bias
            self._levels = key, levels_of_detail(points, aps, header, bias)
        return self._levels[1]


def laser_coordinates(positions: Int32s, origin: Sequence[int], elevation: Ints) -> Int32s:
    """Return the radius, azimuth and laser index (n, 3) of integer positions, as TMC13 does.

    Parameters
    ----------
    positions
        Coordinates (n, 3) relative to the slice's origin.
    origin
        Position of the sensor in the same coordinates.
    elevation
        Tangents of the lasers' elevations in ascending order, in units of 2^-18.
    """
    result = np.empty_like(positions)
    _convert(positions, np.array(origin, dtype=np.int64), elevation, result)
    return result


@entry
def _convert(positions: Int32s, origin: Ints, elevation: Ints, result: Int32s) -> None:
    for i in range(len(positions)):
        x, y, z = row(positions, i)
        x, y, z = x - origin[0], y - origin[1], z - origin[2]
        result[i, 2] = laser_of(elevation, x, y, z)
        x, y = x << 8, y << 8
        result[i, 0] = square_root(x * x + y * y) >> 8
        result[i, 1] = (arc_tangent(y, x) + HALF_TURN) >> 8


def scaled_coordinates(positions: Int32s, scale: Sequence[int]) -> Int32s:
    """Return coordinates (n, 3), shifted to a minimum of 0, times ``scale / 256`` per axis."""
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

"""Surfaces of revolution (cylinders, cones and spheres) with unrolled occupancy maps.

A map is a list of rows. A row is a ring around the axis, one cell high along the profile of the
surface. A ring is divided into as many columns, each one cell wide, as fit around it. All lengths
are in cells.
"""

from __future__ import annotations

import struct
from math import hypot
from typing import NamedTuple

import numpy as np

from pointkit.compiling import compiled, compiled_in_place, inlined
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from primitive_codec.entropy import ContextCoder, code_bit
from primitive_codec.occupancy_map import CONTEXTS as MAP_CONTEXTS
from primitive_codec.occupancy_map import MIXERS as MAP_MIXERS
from primitive_codec.octree_arrays import SPACING_UNIT, Bytes, Ints, first_point
from primitive_codec.stream import REVOLUTION_BYTES
from primitive_codec.vectors import (
    Vector,
    add_multiple,
    cross,
    dot,
    length,
    multiply,
    row_of,
    vector,
)

CONE, SPHERE = 0, 1
MAX_COLUMNS = 1 << 22
"""Largest total number of columns of a stream's surfaces of revolution."""

_ADJACENT = MAP_CONTEXTS
_ABOVE = _ADJACENT + 64
_WIDE = _ABOVE + 16
CONTEXTS = _WIDE + 128
_MIXER = MAP_MIXERS
MIXERS = _MIXER + 1

_PARAMETERS = struct.Struct("<B5hHhhH")
_POSITION, _SLOPE, _RADIUS, _ANGLE = 8, 16384, 16, 20000


class RevolutionSurface(NamedTuple):
    """A cylinder, cone or sphere between two ends. Angles are in radians."""

    kind: int  # CONE (a cylinder if the angle is 0) or SPHERE
    origin: Floats  # (3,) a point on the axis, or a sphere's centre
    axis: Floats  # (3,) unit vector
    radius: float  # at the origin
    angle: float  # half the opening angle, > 0 if the cone widens along the axis
    first_row: int  # arc length along the profile where the first row begins
    row_count: int

    def columns_per_row(self) -> Ints:
        """Return the number of columns of each row (rows,)."""
        radii = self.profile(np.arange(self.row_count, dtype=np.float64) + self.first_row + 0.5)[0]
        return np.asarray(np.maximum(np.rint(2 * np.pi * radii), 0).astype(np.int64))

    def column_count(self) -> int:
        """Return the number of columns of all rows."""
        return int(self.columns_per_row().sum())

    def profile(self, arc_length: Floats) -> tuple[Floats, Floats]:
        """Return the profile of the surface at arc lengths (n,) along it.

        Returns
        -------
        radius
            Distances (n,) from the axis.
        height
            Heights (n,) above the origin, along the axis.
        """
        return _profile(self, arc_length)

    def points_at(self, arc_length: Floats, azimuth: Floats) -> tuple[Floats, Floats]:
        """Return points (n, 3) and their normals (n, 3) at arc lengths (n,) and azimuths (n,)."""
        return _points_at(self, *self.profile(arc_length), azimuth)

    def coordinates(self, xyz: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the position of points (n, 3) with respect to the surface.

        Returns
        -------
        arc_length
            Arc length (n,) along the profile.
        azimuth
            Angle (n,) around the axis.
        distance
            Signed distance (n,) from the surface, positive outside.
        normals
            Unit normals (n, 3) at the nearest points of the surface.
        """
        return _coordinates(self, xyz)


class UnrolledMap(NamedTuple):
    """A surface of revolution with its occupancy map."""

    surface: RevolutionSurface
    bits: Bytes  # (columns,) row after row

    def occupied_columns(self) -> tuple[Ints, Ints, Ints]:
        """Locate the occupied columns.

        Returns
        -------
        row
            Row (m,) of each occupied column.
        column
            Position (m,) of the column in its row.
        columns_in_row
            Number (m,) of all columns of this row.
        """
        columns = self.surface.columns_per_row()
        row = np.repeat(np.arange(self.surface.row_count), columns)
        column = np.arange(len(row)) - np.repeat(np.cumsum(columns) - columns, columns)
        kept = self.bits == 1
        return row[kept], column[kept], columns[row[kept]]


@compiled
def _profile(surface: RevolutionSurface, arc_length: Floats) -> tuple[Floats, Floats]:
    radius, height = np.empty(len(arc_length)), np.empty(len(arc_length))
    sine, cosine = np.sin(surface.angle), np.cos(surface.angle)
    for i in range(len(arc_length)):
        if surface.kind == SPHERE:
            angle = arc_length[i] / surface.radius
            radius[i] = surface.radius * np.cos(angle) if abs(angle) < np.pi / 2 else 0.0
            height[i] = surface.radius * np.sin(angle)
        else:
            radius[i] = surface.radius + arc_length[i] * sine
            height[i] = arc_length[i] * cosine
    return radius, height


@compiled
def _points_at(
    surface: RevolutionSurface, radius: Floats, height: Floats, azimuth: Floats
) -> tuple[Floats, Floats]:
    xyz, normals = np.empty((len(radius), 3)), np.empty((len(radius), 3))
    u, v = orthogonal_axes(surface.axis)
    sine, cosine = np.sin(surface.angle), np.cos(surface.angle)
    for i in range(len(radius)):
        along, across = np.cos(azimuth[i]), np.sin(azimuth[i])
        for a in range(3):
            radial = along * u[a] + across * v[a]
            offset = radius[i] * radial + height[i] * surface.axis[a]
            xyz[i, a] = surface.origin[a] + offset
            if surface.kind == SPHERE:
                normals[i, a] = offset / surface.radius
            else:
                normals[i, a] = radial * cosine - surface.axis[a] * sine
    return xyz, normals


@compiled
def _coordinates(surface: RevolutionSurface, xyz: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    count = len(xyz)
    arc_length, azimuth, distance = np.empty(count), np.empty(count), np.empty(count)
    normals = np.empty((count, 3))
    perpendicular = orthogonal_axes(surface.axis)
    u, v = vector(perpendicular[0]), vector(perpendicular[1])
    sine, cosine = np.sin(surface.angle), np.cos(surface.angle)
    for i in range(count):
        distance[i], height, radius = distance_to(surface, sine, cosine, xyz[i])
        radial = add_multiple(row_of(xyz, i), -1.0, vector(surface.origin))
        azimuth[i] = np.arctan2(dot(radial, v), dot(radial, u))
        if surface.kind == SPHERE:
            sine_of_height = height / max(length(radial), 1e-9)
            arc_length[i] = surface.radius * np.arcsin(min(max(sine_of_height, -1.0), 1.0))
        else:
            arc_length[i] = (radius - surface.radius) * sine + height * cosine
        normal = normal_at(surface, sine, cosine, radial, height, radius)
        for a in range(3):
            normals[i, a] = normal[a]
    return arc_length, azimuth, distance, normals


@compiled_in_place
def distance_to(
    surface: RevolutionSurface, sine: float, cosine: float, point: Floats
) -> tuple[float, float, float]:
    """Return a point's signed distance from a surface, and its cylindrical coordinates.

    Returns
    -------
    tuple of float
        Signed distance from the surface, height above the origin along the axis, and distance from
        the axis.
    """
    x, y, z = (
        point[0] - surface.origin[0],
        point[1] - surface.origin[1],
        point[2] - surface.origin[2],
    )
    a, b, c = surface.axis[0], surface.axis[1], surface.axis[2]
    height = x * a + y * b + z * c
    u, v, w = y * c - z * b, z * a - x * c, x * b - y * a
    radius = np.sqrt(u * u + v * v + w * w)
    if surface.kind == SPHERE:
        distance = max(np.sqrt(x * x + y * y + z * z), 1e-9) - surface.radius
    else:
        distance = (radius - surface.radius) * cosine - height * sine
    return distance, height, radius


@inlined
def normal_at(
    surface: RevolutionSurface,
    sine: float,
    cosine: float,
    radial: Vector,
    height: float,
    radius: float,
) -> Vector:
    """Return the unit normal at the surface point nearest to the point origin + `radial`."""
    if surface.kind == SPHERE:
        return multiply(1 / max(length(radial), 1e-9), radial)
    axis = vector(surface.axis)
    outwards = multiply(1 / max(radius, 1e-9), add_multiple(radial, -height, axis))
    return add_multiple(multiply(cosine, outwards), -sine, axis)


@compiled
def orthogonal_axes(axis: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors (3,) that are orthogonal to an axis and to each other."""
    start = np.zeros(3)
    start[np.abs(axis).argmin()] = 1.0
    u = cross(vector(axis), vector(start))
    u = multiply(1 / length(u), u)
    return np.array(u), np.array(cross(vector(axis), u))


def pack_parameters(surface: RevolutionSurface) -> bytes:
    """Quantise the parameters of a surface, and return them as `REVOLUTION_BYTES` bytes."""
    k = int(np.abs(surface.axis).argmax())
    direction = surface.axis / surface.axis[k]
    slopes = [direction[(k + 1) % 3] * _SLOPE, direction[(k + 2) % 3] * _SLOPE]
    quantised = np.rint([*(surface.origin * _POSITION), *slopes]).clip(-32768, 32767).astype(int)
    sign = 1 if surface.axis[k] > 0 else -1
    radius = min(max(round(surface.radius * _RADIUS), 1), 65535)
    first_row = surface.first_row if sign > 0 else -surface.first_row - surface.row_count
    angle = round(sign * surface.angle * _ANGLE)
    kind_and_axis = surface.kind | k << 1
    return _PARAMETERS.pack(
        kind_and_axis, *quantised.tolist(), radius, angle, first_row, surface.row_count
    )


def is_representable(surface: RevolutionSurface) -> bool:
    """Return whether `pack_parameters` can represent a surface.

    The parameters of the surface may be infinite or NaN; then the result is False.
    """
    if not np.isfinite([*surface.origin, *surface.axis, surface.radius, surface.angle]).all():
        return False
    representable = bool(np.abs(surface.origin * _POSITION).max() < (1 << 15) - 1)
    representable &= round(surface.radius * _RADIUS) < 1 << 16
    representable &= abs(round(surface.angle * _ANGLE)) <= _ANGLE * np.pi / 2
    representable &= abs(surface.first_row) + surface.row_count < 1 << 15
    return bool(representable and surface.column_count() <= MAX_COLUMNS // 2)


def unpack_parameters(stream: bytes) -> list[RevolutionSurface]:
    """Return the surfaces whose parameters `pack_parameters` packed.

    Raises InputError if parameters are invalid or the surfaces have too many columns.
    """
    surfaces = [
        _unpack_surface(stream[k : k + REVOLUTION_BYTES])
        for k in range(0, len(stream), REVOLUTION_BYTES)
    ]
    if sum(surface.column_count() for surface in surfaces) > MAX_COLUMNS:
        raise InputError("the stream is damaged (its surfaces of revolution are too large)")
    return surfaces


def _unpack_surface(fields: bytes) -> RevolutionSurface:
    kind, x, y, z, *slopes, radius, angle, first_row, row_count = _PARAMETERS.unpack(fields)
    k = kind >> 1
    if k > 2 or radius == 0 or row_count > MAX_COLUMNS // 256 or abs(angle) > _ANGLE * np.pi / 2:
        raise InputError("the stream is damaged (its surfaces of revolution are invalid)")
    axis = np.zeros(3)
    axis[k], axis[(k + 1) % 3], axis[(k + 2) % 3] = 1, slopes[0] / _SLOPE, slopes[1] / _SLOPE
    axis /= hypot(*axis)
    origin = np.array([x, y, z]) / _POSITION
    return RevolutionSurface(
        kind & 1, origin, axis, radius / _RADIUS, angle / _ANGLE, first_row, row_count
    )


@compiled
def code_unrolled_map(coder: ContextCoder, columns: Ints, bits: Bytes) -> None:
    """Encode or decode the occupancy map of a surface of revolution.

    Parameters
    ----------
    coder
        Arithmetic coder; its direction decides between encoding and decoding.
    columns
        Number of columns of each row (rows,).
    bits
        One bit for each column, row after row. The encoder reads them, the decoder writes them.
    """
    start, above, second = 0, -1, -1
    for row in range(len(columns)):
        count = columns[row]
        for j in range(count):
            left = bits[start + j - 1] if j > 0 else 0
            left += 2 * bits[start + j - 2] if j > 1 else 0
            above_bits = _adjacent_columns(
                bits, above, columns[row - 1] if row > 0 else 0, j, count
            )
            second_above = _adjacent_columns(
                bits, second, columns[row - 2] if row > 1 else 0, j, count
            )
            # The last column of a ring is beside its first.
            first_of_row = bits[start] if j == count - 1 and j > 0 else 2
            adjacent = (
                _ADJACENT + 16 * min(left & 1, 1) + 2 * above_bits + (1 if first_of_row == 1 else 0)
            )
            above_context = (
                _ABOVE + (left & 1) + 2 * ((above_bits >> 1) & 1) + 4 * ((second_above >> 1) & 1)
            )
            wide = _WIDE + left + 4 * above_bits
            bits[start + j] = code_bit(
                coder, bits[start + j], _MIXER, (adjacent, above_context, wide)
            )
        second, above, start = above, start, start + count


@compiled
def _adjacent_columns(bits: Bytes, start: int, count: int, j: int, columns: int) -> int:
    """Return the bits of the three columns of another row that are nearest to column j."""
    # `start` and `count` are that row's first column and length, `columns` the length of j's row.
    if count == 0 or start < 0:
        return 0
    at = (j * count) // columns
    before, after = (at + count - 1) % count, (at + 1) % count
    return int(4 * bits[start + before] + 2 * bits[start + at] + bits[start + after])


def reconstruct_columns(unrolled: UnrolledMap, spacing: int) -> tuple[Floats, Floats]:
    """Place points on the occupied columns of a surface of revolution.

    Parameters
    ----------
    unrolled
        The surface with its map.
    spacing
        Distance between adjacent points, in columns / `SPACING_UNIT`.

    Returns
    -------
    xyz, normals
        Points and unit normals (n, 3), in cells of the grid.
    """
    surface, (row, column, columns_in_row) = unrolled.surface, unrolled.occupied_columns()
    rows, columns = (first_point(each, spacing) for each in (row, column))
    across = first_point(column + 1, spacing) - columns
    points = (first_point(row + 1, spacing) - rows) * across
    index = np.arange(points.sum()) - np.repeat(np.cumsum(points) - points, points)
    down, aside = np.divmod(index, np.repeat(across, points))
    step = spacing / SPACING_UNIT
    arc_length = surface.first_row + (np.repeat(rows, points) + down + 0.5) * step
    turn = (np.repeat(columns, points) + aside + 0.5) * step
    azimuth = 2 * np.pi * turn / np.repeat(columns_in_row, points)
    return surface.points_at(arc_length, azimuth)


def count_column_points(unrolled: UnrolledMap, spacing: int) -> int:
    """Return how many points `reconstruct_columns` places."""
    row, column, _ = unrolled.occupied_columns()
    down, across = (
        first_point(each + 1, spacing) - first_point(each, spacing) for each in (row, column)
    )
    return int((down * across).sum())


def column_corners(unrolled: UnrolledMap) -> Floats:
    """Return the corners (m, 4, 3) of the occupied columns, in cells of the grid."""
    surface, (row, column, columns_in_row) = unrolled.surface, unrolled.occupied_columns()
    arc_length = (surface.first_row + row)[:, None] + [0, 0, 1, 1]
    azimuth = 2 * np.pi * (column[:, None] + [0, 1, 1, 0]) / columns_in_row[:, None]
    return surface.points_at(arc_length.ravel().astype(float), azimuth.ravel())[0].reshape(-1, 4, 3)

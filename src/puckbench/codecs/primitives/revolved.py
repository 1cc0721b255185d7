"""Cylinders, cones and spheres as surfaces of revolution, unrolled into rows of square cells.

A row is a ring about the axis, one cell high along the profile; it has as many columns as cells
fit around it. All lengths are in cells.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from puckbench.codecs.primitives.entropy import Coder, code_bit
from puckbench.codecs.primitives.layout import Bytes, Ints
from puckbench.codecs.primitives.stream import ROUND
from puckbench.codecs.primitives.support import CONTEXTS as SUPPORT_CONTEXTS
from puckbench.codecs.primitives.support import MIXERS as SUPPORT_MIXERS
from puckbench.core.compiling import compiled
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

CONE, SPHERE = 0, 1
MOST_COLUMNS = 1 << 22
"""Columns of all surfaces of revolution of a stream."""

_NEAR = SUPPORT_CONTEXTS
_FAR = _NEAR + 64
_WIDE = _FAR + 16
CONTEXTS = _WIDE + 128
_MIXER = SUPPORT_MIXERS
MIXERS = _MIXER + 1

_PARAMETERS = struct.Struct("<B5hHhhH")
_PLACE, _SLOPE, _RADIUS, _ANGLE = 8, 16384, 16, 20000


class Round(NamedTuple):
    """A surface of revolution.

    kind: a cone (a cylinder where its angle is 0) or a sphere. origin: (3,) on the axis, a sphere's
    centre; axis: (3,) unit. radius: about the origin. angle: of the cone, radians, by which it
    widens along the axis. first: the first row's place along the profile, rows: how many.
    """

    kind: int
    origin: Floats
    axis: Floats
    radius: float
    angle: float
    first: int
    rows: int

    def columns(self) -> Ints:
        """Columns of each row (rows,)."""
        radii = self.profile(np.arange(self.rows, dtype=np.float64) + self.first + 0.5)[0]
        return np.asarray(np.maximum(np.rint(2 * np.pi * radii), 0).astype(np.int64))

    def profile(self, along: Floats) -> tuple[Floats, Floats]:
        """Radius and height over the origin at places along the profile."""
        if self.kind == SPHERE:
            angle = along / self.radius
            radius = np.where(np.abs(angle) < np.pi / 2, self.radius * np.cos(angle), 0.0)
            return radius, self.radius * np.sin(angle)
        return self.radius + along * np.sin(self.angle), along * np.cos(self.angle)

    def places(self, along: Floats, turn: Floats) -> tuple[Floats, Floats]:
        """Points (n, 3) and normals at places along the profile and angles about the axis."""
        u, v = across(self.axis)
        out = np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v
        radius, height = self.profile(along)
        xyz = self.origin + radius[:, None] * out + height[:, None] * self.axis
        if self.kind == SPHERE:
            return xyz, (xyz - self.origin) / self.radius
        return xyz, out * np.cos(self.angle) - self.axis * np.sin(self.angle)

    def distances(self, xyz: Floats) -> Floats:
        """Signed distances of points (n, 3), as `coordinates` has them, in less time."""
        u, v = across(self.axis)
        vector = xyz - self.origin
        height, radius = vector @ self.axis, np.hypot(vector @ u, vector @ v)
        return self._off(height, radius)

    def _off(self, height: Floats, radius: Floats) -> Floats:
        if self.kind == SPHERE:
            return np.asarray(np.maximum(np.hypot(radius, height), 1e-9) - self.radius)
        off = (radius - self.radius) * np.cos(self.angle) - height * np.sin(self.angle)
        return np.asarray(off)

    def coordinates(self, xyz: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Place along the profile, angle, signed distance and normal of points (n, 3)."""
        u, v = across(self.axis)
        vector = xyz - self.origin
        height, radius = vector @ self.axis, np.hypot(vector @ u, vector @ v)
        turn = np.arctan2(vector @ v, vector @ u)
        if self.kind == SPHERE:
            length = np.maximum(np.hypot(radius, height), 1e-9)
            along = self.radius * np.arcsin(np.clip(height / length, -1, 1))
            return along, turn, self._off(height, radius), vector / length[:, None]
        sine, cosine = np.sin(self.angle), np.cos(self.angle)
        out = (vector - height[:, None] * self.axis) / np.maximum(radius, 1e-9)[:, None]
        along = (radius - self.radius) * sine + height * cosine
        return along, turn, self._off(height, radius), out * cosine - self.axis * sine


def across(axis: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors at right angles to an axis and to each other."""
    start = np.eye(3)[int(np.abs(axis).argmin())]
    u = cross(axis, start)
    u = u / np.linalg.norm(u)
    return u, cross(axis, u)


def cross(a: Floats, b: Floats) -> Floats:
    """Cross product of two vectors (3,); numpy's spends most of its time on finding out axes."""
    x, y, z = a.tolist()
    u, v, w = b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def packed(surface: Round) -> bytes:
    """The parameters in `ROUND` bytes."""
    axis = int(np.abs(surface.axis).argmax())
    direction = surface.axis / surface.axis[axis]
    slopes = [direction[(axis + 1) % 3] * _SLOPE, direction[(axis + 2) % 3] * _SLOPE]
    numbers = np.rint([*(surface.origin * _PLACE), *slopes]).clip(-32768, 32767).astype(int)
    sign = 1 if surface.axis[axis] > 0 else -1
    radius = min(max(round(surface.radius * _RADIUS), 1), 65535)
    first = surface.first if sign > 0 else -surface.first - surface.rows
    angle = round(sign * surface.angle * _ANGLE)
    kind = surface.kind | axis << 1
    return _PARAMETERS.pack(kind, *numbers.tolist(), radius, angle, first, surface.rows)


def fits(surface: Round) -> bool:
    """Whether `packed` has room for a surface; a fit to few samples may have any parameters."""
    if not np.isfinite([*surface.origin, *surface.axis, surface.radius, surface.angle]).all():
        return False
    held = bool(np.abs(surface.origin * _PLACE).max() < (1 << 15) - 1)
    held &= round(surface.radius * _RADIUS) < 1 << 16
    held &= abs(round(surface.angle * _ANGLE)) <= _ANGLE * np.pi / 2
    held &= abs(surface.first) + surface.rows < 1 << 15
    return bool(held and int(surface.columns().sum()) <= MOST_COLUMNS // 2)


def unpacked(stream: bytes) -> list[Round]:
    """Surfaces from the bytes of `packed`, one after the other; InputError for damaged ones."""
    found = [_unpacked(stream[k : k + ROUND]) for k in range(0, len(stream), ROUND)]
    if sum(int(surface.columns().sum()) for surface in found) > MOST_COLUMNS:
        raise InputError("the stream is damaged (its round surfaces are too large)")
    return found


def _unpacked(stream: bytes) -> Round:
    kind, *place, radius, angle, first, rows = _PARAMETERS.unpack(stream)
    axis = np.zeros(3)
    at = kind >> 1
    if at > 2 or radius == 0 or rows > MOST_COLUMNS // 256 or abs(angle) > _ANGLE * np.pi / 2:
        raise InputError("the stream is damaged (its round surfaces make no sense)")
    axis[at], axis[(at + 1) % 3], axis[(at + 2) % 3] = 1, place[3] / _SLOPE, place[4] / _SLOPE
    axis /= np.linalg.norm(axis)
    origin = np.array(place[:3]) / _PLACE
    return Round(kind & 1, origin, axis, radius / _RADIUS, angle / _ANGLE, first, rows)


@compiled
def code_round(coder: Coder, columns: Ints, bits: Bytes) -> None:
    """Code the bitmap of a surface, row after row; bits: (sum of columns,)."""
    start, above, beyond = 0, -1, -1
    for row in range(len(columns)):
        count = columns[row]
        for j in range(count):
            left = bits[start + j - 1] if j > 0 else 0
            left += 2 * bits[start + j - 2] if j > 1 else 0
            up = _around(bits, above, columns[row - 1] if row > 0 else 0, j, count)
            far = _around(bits, beyond, columns[row - 2] if row > 1 else 0, j, count)
            ahead = bits[start] if j == count - 1 and j > 0 else 2
            near = _NEAR + 16 * min(left & 1, 1) + 2 * up + (1 if ahead == 1 else 0)
            straight = _FAR + (left & 1) + 2 * ((up >> 1) & 1) + 4 * ((far >> 1) & 1)
            wide = _WIDE + left + 4 * up
            bits[start + j] = code_bit(coder, bits[start + j], _MIXER, (near, straight, wide))
        beyond, above, start = above, start, start + count


@compiled
def _around(bits: Bytes, start: int, count: int, j: int, columns: int) -> int:
    """Three bits of a row of `count` columns beside column j of one of `columns`."""
    if count == 0 or start < 0:
        return 0
    at = (j * count) // columns
    before, after = (at + count - 1) % count, (at + 1) % count
    return int(4 * bits[start + before] + 2 * bits[start + at] + bits[start + after])


def points_on(surface: Round, bits: Bytes, fineness: int, spread: int) -> tuple[Floats, Floats]:
    """Points (n, 3) and normals on the columns of a surface whose bits are set."""
    rows, place, around = _set_columns(surface, bits)
    if spread > 1:
        kept = (rows % spread == spread // 2) & (place % spread == spread // 2)
        rows, place, around = rows[kept], place[kept], around[kept]
    step = (np.arange(fineness) + 0.5) / fineness
    along = (surface.first + rows)[:, None, None] + step[:, None]
    turn = 2 * np.pi * (place[:, None, None] + step) / around[:, None, None]
    shape = (len(rows), fineness, fineness)
    return surface.places(
        np.broadcast_to(along, shape).ravel(), np.broadcast_to(turn, shape).ravel()
    )


def corners_of(surface: Round, bits: Bytes) -> Floats:
    """Corners (n, 4, 3) of the columns of a surface whose bits are set."""
    rows, place, around = _set_columns(surface, bits)
    along = (surface.first + rows)[:, None] + [0, 0, 1, 1]
    turn = 2 * np.pi * (place[:, None] + [0, 1, 1, 0]) / around[:, None]
    return surface.places(along.ravel().astype(float), turn.ravel())[0].reshape(-1, 4, 3)


def _set_columns(surface: Round, bits: Bytes) -> tuple[Ints, Ints, Ints]:
    """Row and place of the columns whose bits are set, and how many columns their rows have."""
    columns = surface.columns()
    rows = np.repeat(np.arange(surface.rows), columns)
    place = np.arange(len(rows)) - np.repeat(np.cumsum(columns) - columns, columns)
    kept = bits == 1
    return rows[kept], place[kept], columns[rows[kept]]

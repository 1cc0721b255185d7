"""Solids with labelled faces: boxes, extrusions, solids of revolution, sweeps, superquadrics.

`steps` is always the number of segments of a full circle.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pointkit.geometry.cloud import Floats
from virtual_lidar.scenes.outlines import Outline, Segment, arc, fill, line, loop
from virtual_lidar.scenes.surfaces import (
    FREEFORM,
    PLANE,
    Shape,
    Surface,
    frame_along,
    freeform,
    grid,
    join,
    planar,
)

_BOX_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)])
_BOX_QUADS = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
_BOX_TRIANGLES = _BOX_QUADS[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
_BOX_NORMALS = ((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1))
_BOX_FRAMES = np.stack([frame_along(np.array(n, dtype=float), np.zeros(3)) for n in _BOX_NORMALS])


def box(x: float, y: float, z: float) -> Surface:
    """Make a box of size (x, y, z) that stands on z = 0, centred in x and y."""
    vertices = _BOX_CORNERS * (x, y, z)
    frames = _BOX_FRAMES.copy()
    frames[:, :3, 3] = vertices[_BOX_QUADS[:, 0]]
    return Surface(vertices, _BOX_TRIANGLES, np.repeat(np.arange(6), 2), (PLANE,) * 6, frames)


def flat(outline: Outline, holes: Sequence[Outline] = ()) -> Surface:
    """Make a flat face at z = 0, facing up, from a counter-clockwise outline and holes."""
    vertices, triangles = fill(loop(outline), [loop(hole) for hole in holes])
    return planar(np.column_stack([vertices, np.zeros(len(vertices))]), triangles)


def extrude(outline: Outline, height: float, holes: Sequence[Outline] = ()) -> Surface:
    """Make a solid from z = 0 to `height` with the base that `flat` makes.

    Its primitives are, in this order, the lid, the base, a side for each segment of `outline`, and
    the sides of the holes.
    """
    lid = flat(outline, holes)
    base = lid.flipped()
    sides = [_side(segment, height) for segment in outline]
    bores = [_side(segment, height).flipped() for hole in holes for segment in hole]
    return join([lid.at(z=height), base, *sides, *bores])


def revolve(profile: Outline, steps: int, degrees: float = 360.0) -> Surface:
    """Make a solid of revolution about z.

    Lines of the profile give planes, cylinders and cones, arcs give spheres and tori, and curves
    give freeform surfaces.

    Parameters
    ----------
    profile
        Outline in (r, z) with the solid on its left; that of a closed solid leads from the axis at
        the bottom to the axis at the top.
    steps
        Number of segments around the axis.
    degrees
        Angle of the revolution.
    """
    closed = degrees >= 360.0
    count = steps if closed else steps + 1
    angles = np.radians(np.linspace(0, degrees, count, endpoint=not closed))
    return join([_turned(segment, angles, closed) for segment in profile])


def cylinder(radius: float, height: float, steps: int) -> Surface:
    """Make an upright cylinder on z = 0."""
    return revolve(line((0, 0), (radius, 0), (radius, height), (0, height)), steps)


def cone(bottom: float, top: float, height: float, steps: int) -> Surface:
    """Make an upright cone or frustum on z = 0, with the radii `bottom` and `top`."""
    points = [(0.0, 0.0), (bottom, 0.0), (top, height), (0.0, height)]
    distinct = [p for p, q in zip(points, [*points[1:], None], strict=True) if p != q]
    return revolve(line(*distinct), steps)


def sphere(radius: float, steps: int) -> Surface:
    """Make a sphere around the origin."""
    return revolve(arc((0, 0), radius, -90, 90, max(steps // 2, 4)), steps)


def torus(major: float, minor: float, steps: int, around: int) -> Surface:
    """Make a torus around the origin, about z, with `around` segments around its tube."""
    return revolve(arc((major, 0), minor, 0, 360, around), steps)


def superquadric(
    sizes: tuple[float, float, float], exponents: tuple[float, float], steps: int
) -> Surface:
    """Make a superellipsoid around the origin.

    With the half axes a, b, c (`sizes`) and the `exponents` e1, e2, its surface is
    |z/c|^(2/e1) + (|x/a|^(2/e2) + |y/b|^(2/e2))^(e2/e1) = 1. Exponents (1, 1) give an ellipsoid,
    smaller exponents a rounded box.
    """
    latitude = np.linspace(-np.pi / 2, np.pi / 2, max(steps // 2, 4) + 1)[:, None]
    longitude = np.linspace(0, 2 * np.pi, steps, endpoint=False)[None, :]
    ring = _power(np.cos(latitude), exponents[0])
    ring[[0, -1]] = 0.0
    x = sizes[0] * ring * _power(np.cos(longitude), exponents[1])
    y = sizes[1] * ring * _power(np.sin(longitude), exponents[1])
    z = sizes[2] * _power(np.sin(latitude), exponents[0]) * np.ones_like(longitude)
    shape = Shape("superquadric", sizes, exponents)
    points = np.stack([x, y, z], axis=-1)
    return grid(points.swapaxes(0, 1), shape, closed=(True, False))


def tube(path: Floats, radius: float | Floats, steps: int, *, closed: bool = False) -> Surface:
    """Sweep a circle, with one radius or a radius per point, along a path (n, 3).

    The result is a freeform surface with flat ends, or without ends if `closed`.
    """
    sections = _rings(path, np.broadcast_to(radius, len(path)), steps, closed)
    if closed:
        return grid(sections, closed=(True, True)).flipped()
    return loft(sections)


def loft(sections: Floats) -> Surface:
    """Connect successive closed sections by a freeform surface, and close both ends.

    Parameters
    ----------
    sections
        Points of k sections of n points, (k, n, 3). They are counter-clockwise as seen from the
        last section towards the first.
    """
    skin = grid(sections.swapaxes(0, 1), closed=(True, False))
    return join([skin, _fan(sections[0]).flipped(), _fan(sections[-1])])


def pipe(points: Sequence[Sequence[float]], radius: float, bend: float, steps: int) -> Surface:
    """Make a pipe with closed ends along points, from cylinders and elbows (parts of tori).

    `bend` is the radius of the elbows, measured to the middle of the pipe.
    """
    path = np.array(points, dtype=np.float64)
    starts, ends, parts = path.copy(), path.copy(), []
    for i in range(1, len(path) - 1):
        elbow, starts[i], ends[i] = _elbow(path[i - 1 : i + 2], radius, bend, steps)
        parts.append(elbow)
    parts += [_straight(ends[i], starts[i + 1], radius, steps) for i in range(len(path) - 1)]
    cap = revolve(line((radius, 0), (0, 0)), steps)
    first = cap.transformed(frame_along(ends[0] - starts[1], ends[0]))
    return join([*parts, first, cap.transformed(frame_along(starts[-1] - ends[-2], starts[-1]))])


def sheet(points: Floats, thickness: float) -> Surface:
    """Make a freeform plate whose middle passes through a grid of points (m, n, 3)."""
    rows, columns = np.gradient(points, axis=0), np.gradient(points, axis=1)
    normal = np.cross(rows, columns)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = normal / np.where(length > 1e-12, length, 1.0)
    upper, lower = points + normal * thickness / 2, points - normal * thickness / 2
    rim = [
        np.concatenate([side[0], side[1:, -1], side[-1, -2::-1], side[-2:0:-1, 0]])
        for side in (upper, lower)
    ]
    edge = grid(np.stack(rim), closed=(False, True)).flipped()
    return join([grid(upper), grid(lower).flipped(), edge])


def _power(values: Floats, exponent: float) -> Floats:
    return np.asarray(np.sign(values) * np.abs(values) ** exponent)


def _side(segment: Segment, height: float) -> Surface:
    bottom = np.column_stack([segment.points, np.zeros(len(segment.points))])
    points = np.stack([bottom, bottom + np.array([0.0, 0.0, height])], axis=1)
    if segment.kind == "arc":
        frame = np.eye(4)
        frame[:2, 3] = segment.centre
        return grid(points, Shape("cylinder", (segment.radius,)), frame)
    if segment.kind == "curve":
        return grid(points)
    along = points[-1, 0] - points[0, 0]
    return grid(points, PLANE, frame_along(np.cross(along, (0.0, 0.0, 1.0)), points[0, 0]))


def _turned(segment: Segment, angles: Floats, closed: bool) -> Surface:
    r, z = segment.points[:, 0], segment.points[:, 1]
    x, y = np.cos(angles)[:, None] * r, np.sin(angles)[:, None] * r
    points = np.stack([x, y, np.broadcast_to(z, x.shape)], axis=-1)
    shape, frame = _turned_shape(segment)
    return grid(points, shape, frame, closed=(closed, False))


def _turned_shape(segment: Segment) -> tuple[Shape, Floats]:
    (r0, z0), (r1, z1) = segment.points[[0, -1]]
    frame = np.eye(4)
    if segment.kind == "arc":
        frame[2, 3] = segment.centre[1]
        if abs(segment.centre[0]) < 1e-12:
            return Shape("sphere", (segment.radius,)), frame
        lengths = (segment.centre[0], segment.radius)
        return (Shape("torus", lengths), frame) if segment.centre[0] > 0 else (FREEFORM, frame)
    if segment.kind == "curve":
        return FREEFORM, frame
    if abs(z1 - z0) < 1e-12:
        return PLANE, frame_along(np.array([0, 0, -1.0 if r1 > r0 else 1.0]), np.array([0, 0, z0]))
    if abs(r1 - r0) < 1e-12:
        return Shape("cylinder", (float(r0),)), frame
    slope = (r1 - r0) / (z1 - z0)
    apex = np.array([0.0, 0.0, z0 - r0 / slope])
    axis = np.array([0.0, 0.0, np.sign(slope)])
    return Shape("cone", (), (float(np.arctan(abs(slope))),)), frame_along(axis, apex)


def _fan(ring: Floats) -> Surface:
    count = len(ring)
    vertices = np.concatenate([ring, ring.mean(axis=0, keepdims=True)])
    index = np.arange(count)
    triangles = np.column_stack([index, np.roll(index, -1), np.full(count, count)])
    return freeform(vertices, triangles)


def _rings(path: Floats, radii: Floats, steps: int, closed: bool) -> Floats:
    ahead = np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0)
    if not closed:
        ahead[0], ahead[-1] = path[1] - path[0], path[-1] - path[-2]
    tangent = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
    side = np.empty_like(tangent)
    side[0] = frame_along(tangent[0], np.zeros(3))[:3, 0]
    for i in range(1, len(path)):
        across = side[i - 1] - (side[i - 1] @ tangent[i]) * tangent[i]
        side[i] = across / np.linalg.norm(across)
    other = np.cross(tangent, side)
    angles = np.linspace(0, 2 * np.pi, steps, endpoint=False)[None, :, None]
    circle = np.cos(angles) * side[:, None] + np.sin(angles) * other[:, None]
    return np.asarray(path[:, None] + radii[:, None, None] * circle)


def _straight(start: Floats, end: Floats, radius: float, steps: int) -> Surface:
    length = float(np.linalg.norm(end - start))
    side = revolve(line((radius, 0), (radius, length)), steps)
    return side.transformed(frame_along(end - start, start))


def _elbow(
    corner: Floats, radius: float, bend: float, steps: int
) -> tuple[Surface, Floats, Floats]:
    """Return the elbow at the middle of three points (3, 3), and the two points where it ends."""
    before, at, after = corner
    towards = (before - at) / np.linalg.norm(before - at)
    onwards = (after - at) / np.linalg.norm(after - at)
    half = np.arccos(np.clip(towards @ onwards, -1, 1)) / 2
    begin, finish = at + towards * bend / np.tan(half), at + onwards * bend / np.tan(half)
    middle = towards + onwards
    centre = at + middle / np.linalg.norm(middle) * bend / np.sin(half)
    x = (begin - centre) / bend
    z = np.cross(x, -towards)
    frame = np.eye(4)
    frame[:3] = np.column_stack([x, np.cross(z, x), z, centre])
    sweep = 180.0 - 2 * np.degrees(half)
    section = arc((bend, 0), radius, 0, 360, steps)
    return revolve(section, max(3, steps // 2), sweep).transformed(frame), begin, finish

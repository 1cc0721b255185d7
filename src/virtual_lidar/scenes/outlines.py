from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pointkit.geometry.cloud import Floats, Ints

Point = tuple[float, float]


@dataclass(frozen=True)
class Segment:
    """A part of an outline in the plane: a polyline, an arc or a smooth curve.

    Parameters
    ----------
    kind
        ``"line"``, ``"arc"`` or ``"curve"``.
    points
        Successive points, (n, 2).
    centre, radius
        Centre and radius of an arc; not used for other kinds.
    """

    kind: str
    points: Floats
    centre: Point = (0.0, 0.0)
    radius: float = 0.0


Outline = tuple[Segment, ...]
"""Segments, each of which begins where the one before it ends; the last may end at the start."""


def line(*points: Point) -> Outline:
    """Make a polyline through points."""
    pairs = pairwise(points)
    return tuple(Segment("line", np.array(pair, dtype=np.float64)) for pair in pairs)


def ring(*paths: Outline) -> Outline:
    """Make a closed outline from paths, with a line from the end of each path to the next path."""
    following = (*paths[1:], paths[0])
    return tuple(
        segment
        for path, other in zip(paths, following, strict=True)
        for segment in (*path, *line(point(path[-1].points[-1]), point(other[0].points[0])))
    )


def point(values: Floats) -> Point:
    """Convert an array (2,) to a point."""
    return (float(values[0]), float(values[1]))


def polygon(*points: Point) -> Outline:
    """Make a closed polygon with these corners."""
    return line(*points, points[0])


def rectangle(width: float, depth: float) -> Outline:
    """Make a rectangle around (0, 0), counter-clockwise; `width` is along x, `depth` along y."""
    x, y = width / 2, depth / 2
    return polygon((-x, -y), (x, -y), (x, y), (-x, y))


def arc(centre: Point, radius: float, start: float, end: float, steps: int) -> Outline:
    """Make an arc of `steps` lines between two angles, degrees.

    It is counter-clockwise if `end` is greater than `start`.
    """
    angles = np.radians(np.linspace(start, end, steps + 1))
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    return (Segment("arc", np.asarray(centre) + radius * circle, centre, radius),)


def circle(radius: float, steps: int, centre: Point = (0.0, 0.0)) -> Outline:
    """Make a circle of `steps` lines, counter-clockwise."""
    return arc(centre, radius, 0.0, 360.0, steps)


def curve(points: Sequence[Point], steps: int) -> Outline:
    """Make a smooth (Catmull-Rom) curve through points, with `steps` lines between two of them."""
    smooth = catmull_rom(np.array(points, dtype=np.float64), steps)
    return (Segment("curve", smooth),)


def closed_curve(points: Sequence[Point], steps: int) -> Outline:
    """Make a closed smooth curve through points, with `steps` lines between two of them."""
    ring = np.array(points, dtype=np.float64)
    wrapped = np.concatenate([ring[-2:], ring, ring[:3]])
    smooth = catmull_rom(wrapped, steps)[2 * steps : (2 + len(ring)) * steps + 1]
    return (Segment("curve", smooth),)


def rounded(points: Sequence[Point], radius: float, steps: int) -> Outline:
    """Make a closed polygon whose corners are arcs of `steps` lines."""
    corners = np.array(points, dtype=np.float64)
    before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
    arcs = [_fillet(a, b, c, radius, steps) for a, b, c in zip(before, corners, after, strict=True)]
    segments: list[Segment] = []
    for fillet, following in zip(arcs, [*arcs[1:], arcs[0]], strict=True):
        ends = np.stack([fillet.points[-1], following.points[0]])
        segments.append(fillet)
        if np.linalg.norm(ends[1] - ends[0]) > 1e-9:
            segments.append(Segment("line", ends))
    return tuple(segments)


def rounded_rectangle(width: float, depth: float, radius: float, steps: int) -> Outline:
    """Make a rectangle, as `rectangle` does, whose corners are arcs of `steps` lines."""
    x, y = width / 2, depth / 2
    return rounded([(-x, -y), (x, -y), (x, y), (-x, y)], radius, steps)


def shifted(outline: Outline, x: float, y: float) -> Outline:
    """Return an outline that is moved by (x, y)."""
    shift = np.array([x, y])
    return tuple(
        replace(each, points=each.points + shift, centre=point(each.centre + shift))
        for each in outline
    )


def polar(radius: float, angles: Floats) -> list[Point]:
    """Return points on a circle around (0, 0) at angles (n,), rad."""
    return [(radius * float(np.cos(t)), radius * float(np.sin(t))) for t in angles]


def loop(outline: Outline) -> Floats:
    """Return the distinct points (n, 2) of a closed outline."""
    return np.concatenate([segment.points[:-1] for segment in outline])


def catmull_rom(points: Floats, steps: int) -> Floats:
    """Return points on a smooth curve through the given points, (n, dimensions).

    The result has `steps` points for each given point but the last, and then the last point.
    """
    padded = np.concatenate([2 * points[:1] - points[1:2], points, 2 * points[-1:] - points[-2:-1]])
    a, b, c, d = (padded[start : len(padded) - 3 + start] for start in range(4))
    t = np.linspace(0, 1, steps, endpoint=False)[None, :, None]
    a, b, c, d = (points[:, None, :] for points in (a, b, c, d))
    blend = 2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2
    blend = (blend + (3 * b - a - 3 * c + d) * t**3) / 2
    return np.concatenate([blend.reshape(-1, points.shape[1]), points[-1:]])


def fill(outer: Floats, holes: Sequence[Floats] = ()) -> tuple[Floats, Ints]:
    """Triangulate a polygon with holes, by ear clipping.

    Parameters
    ----------
    outer
        Corners of the polygon, counter-clockwise, (n, 2).
    holes
        Corners of the holes, (m, 2), in either direction.

    Returns
    -------
    vertices, triangles
        The corners of the polygon and then of the holes, (v, 2), and indices of three of them for
        each triangle, (t, 3), counter-clockwise.
    """
    vertices = np.concatenate([outer, *holes])
    ring = list(range(len(outer)))
    first = len(outer)
    rings = []
    for hole in holes:
        indices = np.arange(first, first + len(hole))
        rings.append(indices[::-1] if _area(hole) > 0 else indices)
        first += len(hole)
    rings.sort(key=lambda indices: -float(vertices[indices, 0].max()))
    for indices in rings:
        ring = _bridged(vertices, ring, indices)
    return vertices, _ears(vertices, ring)


def _fillet(before: Floats, corner: Floats, after: Floats, radius: float, steps: int) -> Segment:
    towards, onwards = _unit(before - corner), _unit(after - corner)
    half = np.arccos(np.clip(towards @ onwards, -1, 1)) / 2
    centre = corner + _unit(towards + onwards) * radius / np.sin(half)
    start = corner + towards * radius / np.tan(half) - centre
    left = bool(_cross(corner - before, after - corner) > 0)
    sweep = np.linspace(0, np.pi - 2 * half, steps + 1) * (1 if left else -1)
    x = start[0] * np.cos(sweep) - start[1] * np.sin(sweep)
    y = start[0] * np.sin(sweep) + start[1] * np.cos(sweep)
    return Segment("arc", centre + np.column_stack([x, y]), point(centre), radius)


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _area(points: Floats) -> float:
    return float(_cross(points, np.roll(points, -1, axis=0)).sum() / 2)


def _bridged(vertices: Floats, ring: list[int], hole: Ints) -> list[int]:
    """Connect a hole to a ring of vertex indices by the shortest segment that crosses no edge."""
    start = int(np.argmax(vertices[hole, 0]))
    hole = np.roll(hole, -start)
    tip = vertices[hole[0]]
    edges = np.array([[*ring, *hole], [*ring[1:], ring[0], *hole[1:], hole[0]]])
    order = np.argsort(np.sum((vertices[ring] - tip) ** 2, axis=1), kind="stable")
    place = next(int(at) for at in order if not _crosses(tip, vertices[ring[at]], vertices[edges]))
    return [*ring[: place + 1], *hole.tolist(), int(hole[0]), *ring[place:]]


def _crosses(start: Floats, end: Floats, edges: Floats) -> bool:
    a, b = edges
    first = _cross(end - start, a - start) * _cross(end - start, b - start)
    second = _cross(b - a, start - a) * _cross(b - a, end - a)
    return bool(np.any((first < -1e-18) & (second < -1e-18)))


def _ears(vertices: Floats, ring: list[int]) -> Ints:
    triangles = []
    ring = list(ring)
    at = misses = 0
    while len(ring) > 3:
        at %= len(ring)
        a, b, c = ring[at - 1], ring[at], ring[(at + 1) % len(ring)]
        misses += 1
        if _is_ear(vertices, ring, (a, b, c)) or misses > len(ring) + 1:
            triangles.append((a, b, c))
            del ring[at]
            misses = 0
        at += 1
    return np.array([*triangles, ring], dtype=np.int64)


def _is_ear(vertices: Floats, ring: list[int], triple: tuple[int, int, int]) -> bool:
    a, b, c = vertices[list(triple)]
    if float(_cross(b - a, c - b)) <= 1e-15:
        return False
    others = vertices[ring]
    inside = (_cross(b - a, others - a) > -1e-12) & (_cross(c - b, others - b) > -1e-12)
    inside &= _cross(a - c, others - c) > -1e-12
    corner = (others == a).all(axis=1) | (others == b).all(axis=1) | (others == c).all(axis=1)
    return not bool(np.any(inside & ~corner))

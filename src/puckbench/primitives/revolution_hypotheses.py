"""Surfaces of revolution through two or three samples with normals, as hypotheses of a surface."""

from __future__ import annotations

import numpy as np

from puckbench.core.compiling import compiled, compiled_in_place, inlined
from puckbench.geometry.cloud import Floats
from puckbench.geometry.vectors import Vector, add_multiple, cross, dot, length, multiply, row_of
from puckbench.primitives.octree_arrays import Ints
from puckbench.primitives.revolution import CONE, SPHERE, RevolutionSurface
from puckbench.primitives.smoothing import BlockedSamples, Samples, blocks_of, runs_near

SPANS = (3.0, 6.0, 12.0)
"""Distances of the samples of a hypothesis, in sampling cells."""
_NEAREST = 0.6
"""Distance of the nearest one, as share of the farthest one's."""
_PRIMES = (7919, 104729)
"""Multiples of a seed's row choose the two others, here and there around it."""
_MIN_BEND = 1e-4
"""Squared difference of two normals, at least."""
_MIN_AXIS, _MIN_VOLUME = 0.02, 1e-3
"""Of a cone: least length of its axis as computed, least determinant of three normals."""
_ANGLES = (0.02, 1.3)
_SIZE = 9


def blocks_around(xyz: Floats, radius: float) -> tuple[Ints, BlockedSamples]:
    """Samples (n, 3) in blocks as large as a radius, after the order (n,) that sorts them so."""
    cells = np.floor(xyz / radius).astype(np.int64)
    return blocks_of(Samples(xyz, np.ones(len(xyz)), cells), 1)


def hypotheses_through(
    xyz: Floats, normals: Floats, seeds: Ints, cell: float, tolerance: float
) -> Floats:
    """Spheres, cylinders and cones, without ends yet, through some samples and their normals.

    Parameters
    ----------
    xyz, normals
        Samples (n, 3) and their unit normals.
    seeds
        (m,) rows of the samples that are looked at, each with two others at each of three spans.
    cell
        Spacing of the samples.
    tolerance
        Least radius; a sphere or cylinder may miss the second sample by twice as much.

    Returns
    -------
    ndarray
        (m, 9) numbers that `hypothesis` makes a surface of.
    """
    largest = float(np.ptp(xyz, axis=0).max()) / 2
    found, count = np.empty((3 * len(SPANS) * len(seeds), _SIZE)), 0
    place = np.empty(len(xyz), np.int64)
    for span in SPANS:
        order, blocked = blocks_around(xyz, span * cell)
        place[order] = np.arange(len(xyz))
        count = _through_seeds(
            blocked,
            normals[order],
            place[seeds],
            span * cell,
            (tolerance, largest),
            found,
            count,
        )
    return found[:count]


@compiled
def hypothesis(numbers: Floats) -> RevolutionSurface:
    """The surface of some numbers (9,): kind, origin (3), axis (3), radius, angle."""
    kind, ends = int(numbers[0]), (0, 0)
    return RevolutionSurface(kind, numbers[1:4], numbers[4:7], numbers[7], numbers[8], *ends)


@compiled
def _through_seeds(
    blocked: BlockedSamples,
    normals: Floats,
    seeds: Ints,
    radius: float,
    limits: tuple[float, float],
    found: Floats,
    count: int,
) -> int:
    """Write hypotheses (m, 9) through seeds and two samples about a radius away; their number.

    limits: tolerance, largest radius.
    """
    runs = np.empty((9, 2), np.int64)
    for seed in seeds:
        block = np.searchsorted(blocked.starts, seed, side="right") - 1
        near = runs_near(blocked, block, 1, runs)
        others, _ = _others(blocked.xyz, seed, near, radius, (-1, -1))
        if others >= 2:
            wanted = (_PRIMES[0] * seed % others, _PRIMES[1] * seed % others)
            _, rows = _others(blocked.xyz, seed, near, radius, wanted)
            count = _through_samples(blocked.xyz, normals, (seed, *rows), limits, found, count)
    return int(count)


@compiled_in_place
def _others(
    xyz: Floats, seed: int, runs: Ints, radius: float, wanted: tuple[int, int]
) -> tuple[int, tuple[int, int]]:
    """The number of samples about a radius away from one, and the rows of two of them."""
    least, most = (_NEAREST * radius) ** 2, radius * radius
    count, first, second = 0, -1, -1
    for k in range(len(runs)):
        for j in range(runs[k, 0], runs[k, 1]):
            apart = add_multiple(row_of(xyz, j), -1.0, row_of(xyz, seed))
            if least < dot(apart, apart) <= most:
                first = j if count == wanted[0] else first
                second = j if count == wanted[1] else second
                count += 1
    return count, (first, second)


@compiled_in_place
def _through_samples(
    xyz: Floats,
    normals: Floats,
    rows: tuple[int, int, int],
    limits: tuple[float, float],
    found: Floats,
    count: int,
) -> int:
    """Write the sphere and the cylinder through the first two of three samples, and the cone."""
    a, n = row_of(xyz, rows[0]), row_of(normals, rows[0])
    m, o = _along(row_of(normals, rows[1]), n), _along(row_of(normals, rows[2]), n)
    apart, bend = add_multiple(a, -1.0, row_of(xyz, rows[1])), add_multiple(n, -1.0, m)
    if dot(bend, bend) < _MIN_BEND:
        return count
    for kind in (SPHERE, CONE):
        axis = (0.0, 0.0, 1.0)
        if kind == CONE:
            across = cross(n, m)
            if length(across) == 0.0:
                continue
            axis = multiply(1 / length(across), across)
            apart = add_multiple(apart, -dot(apart, axis), axis)
        radius = dot(apart, bend) / dot(bend, bend)
        if length(add_multiple(apart, -radius, bend)) < 2 * limits[0]:
            origin = add_multiple(a, -radius, n)
            count = _add(kind, origin, axis, (abs(radius), 0.0), limits, found, count)
    return _cone(xyz, rows, (n, m, o), limits, found, count)


@compiled_in_place
def _cone(
    xyz: Floats,
    rows: tuple[int, int, int],
    normals: tuple[Vector, Vector, Vector],
    limits: tuple[float, float],
    found: Floats,
    count: int,
) -> int:
    """Write the cone whose tangent planes at three samples are those of the samples."""
    n, m, o = normals
    a, b, c = row_of(xyz, rows[0]), row_of(xyz, rows[1]), row_of(xyz, rows[2])
    axis = cross(add_multiple(n, -1.0, m), add_multiple(n, -1.0, o))
    volume = dot(n, cross(m, o))
    if length(axis) < _MIN_AXIS or abs(volume) < _MIN_VOLUME:
        return count
    apex = multiply(dot(n, a) / volume, cross(m, o))
    apex = add_multiple(apex, dot(m, b) / volume, cross(o, n))
    apex = add_multiple(apex, dot(o, c) / volume, cross(n, m))
    middle = multiply(1 / 3, add_multiple(add_multiple(a, 1.0, b), 1.0, c))
    out = add_multiple(middle, -1.0, apex)
    axis = multiply((1 if dot(out, axis) > 0 else -1) / length(axis), axis)
    height = dot(out, axis)
    angle = (_angle(a, apex, axis) + _angle(b, apex, axis) + _angle(c, apex, axis)) / 3
    if _ANGLES[0] < angle < _ANGLES[1]:
        origin = add_multiple(apex, height, axis)
        count = _add(CONE, origin, axis, (height * np.tan(angle), angle), limits, found, count)
    return count


@inlined
def _angle(point: Vector, apex: Vector, axis: Vector) -> float:
    """Half the opening angle of the cone on which a point lies."""
    out = add_multiple(point, -1.0, apex)
    height = dot(out, axis)
    return float(np.arctan2(length(add_multiple(out, -height, axis)), height))


@inlined
def _along(normal: Vector, other: Vector) -> Vector:
    """A normal on the side of another one."""
    return multiply(-1.0 if dot(normal, other) < 0 else 1.0, normal)


@inlined
def _add(
    kind: int,
    origin: Vector,
    axis: Vector,
    radius_and_angle: tuple[float, float],
    limits: tuple[float, float],
    found: Floats,
    count: int,
) -> int:
    """Write a hypothesis, unless its radius is out of bounds; the number of them."""
    radius, angle = radius_and_angle
    if not limits[0] < radius < limits[1]:
        return count
    found[count, 0], found[count, 7], found[count, 8] = kind, radius, angle
    for k in range(3):
        found[count, 1 + k], found[count, 4 + k] = origin[k], axis[k]
    return count + 1

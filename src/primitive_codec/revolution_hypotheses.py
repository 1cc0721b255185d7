from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.compiling import compiled, compiled_in_place, inlined
from pointkit.geometry.cloud import Floats
from primitive_codec.octree_arrays import Ints
from primitive_codec.revolution import CONE, SPHERE, RevolutionSurface
from primitive_codec.smoothing import BlockedSamples, CellSamples, blocks_of, ranges_near
from primitive_codec.vectors import Vector, add_multiple, cross, dot, length, multiply, row_of

SPANS = (3.0, 6.0, 12.0)
"""Largest distances of a hypothesis's samples, in sampling cells."""
_MIN_DISTANCE = 0.6
"""Least distance of samples, as a fraction of the largest."""
_PRIMES = (7919, 104729)
"""Multipliers that select two samples pseudo-randomly from the row of a seed."""
_MIN_BEND = 1e-4
"""Smallest squared length of the difference of two normals."""
_MIN_AXIS_LENGTH, _MIN_VOLUME = 0.02, 1e-3
"""Limits for a well-conditioned cone: length of the unnormalised axis, determinant of three
normals."""
_ANGLES = (0.02, 1.3)
_FIELDS = 9


class _Hypotheses(NamedTuple):
    fields: Floats  # (m, 9), see `surface_of_hypothesis`
    size: Ints  # (1,) number of rows in use
    tolerance: float  # least radius
    max_radius: float


def block_samples(xyz: Floats, radius: float) -> tuple[Ints, BlockedSamples]:
    """Sort samples (n, 3) by blocks of side `radius`, and return the order (n,) with the result."""
    cells = np.floor(xyz / radius).astype(np.int64)
    return blocks_of(CellSamples(xyz, np.ones(len(xyz)), cells), 1)


def make_hypotheses(
    xyz: Floats, normals: Floats, seeds: Ints, spacing: float, tolerance: float
) -> Floats:
    """Propose spheres, cylinders and cones that pass through a few samples of a surface.

    Each seed is combined with two other samples, at each of three distances from the seed.

    Parameters
    ----------
    xyz, normals
        Samples and their unit normals (n, 3).
    seeds
        Indices of the samples from which proposals start.
    spacing
        Distance between adjacent samples.
    tolerance
        Least radius of a proposal. The second sample may lie up to twice as far from a sphere or
        cylinder.

    Returns
    -------
    ndarray
        Proposals (m, 9), which `surface_of_hypothesis` turns into surfaces without ends.
    """
    fields = np.empty((3 * len(SPANS) * len(seeds), _FIELDS))
    max_radius = float(np.ptp(xyz, axis=0).max()) / 2
    hypotheses = _Hypotheses(fields, np.zeros(1, np.int64), tolerance, max_radius)
    sorted_row = np.empty(len(xyz), np.int64)
    for span in SPANS:
        order, blocks = block_samples(xyz, span * spacing)
        sorted_row[order] = np.arange(len(xyz))
        _sample_hypotheses(blocks, normals[order], sorted_row[seeds], span * spacing, hypotheses)
    return fields[: hypotheses.size[0]]


@compiled
def surface_of_hypothesis(fields: Floats) -> RevolutionSurface:
    """Return the surface that a row (9,) of `make_hypotheses` describes.

    The row holds kind, origin (3), axis (3), radius and angle. The surface has no rows yet.
    """
    kind, ends = int(fields[0]), (0, 0)
    return RevolutionSurface(kind, fields[1:4], fields[4:7], fields[7], fields[8], *ends)


@compiled
def _sample_hypotheses(
    blocks: BlockedSamples, normals: Floats, seeds: Ints, radius: float, hypotheses: _Hypotheses
) -> None:
    """Append hypotheses through each seed and two samples at 0.6 to 1 times `radius`."""
    ranges = np.empty((9, 2), np.int64)
    for seed in seeds:
        block = np.searchsorted(blocks.starts, seed, side="right") - 1
        near_ranges = ranges_near(blocks, block, 1, ranges)
        count_around, _ = _annulus_samples(blocks.xyz, seed, near_ranges, radius, (-1, -1))
        if count_around >= 2:
            selection = (_PRIMES[0] * seed % count_around, _PRIMES[1] * seed % count_around)
            _, rows = _annulus_samples(blocks.xyz, seed, near_ranges, radius, selection)
            _add_hypotheses(blocks.xyz, normals, (seed, *rows), hypotheses)


@compiled_in_place
def _annulus_samples(
    xyz: Floats, seed: int, ranges: Ints, radius: float, selection: tuple[int, int]
) -> tuple[int, tuple[int, int]]:
    """Count the samples at 0.6 to 1 times `radius` from a seed."""
    # Also return the indices of the two samples at positions `selection` in this count.
    min_squared, max_squared = (_MIN_DISTANCE * radius) ** 2, radius * radius
    count, first, second = 0, -1, -1
    for k in range(len(ranges)):
        for j in range(ranges[k, 0], ranges[k, 1]):
            offset = add_multiple(row_of(xyz, j), -1.0, row_of(xyz, seed))
            if min_squared < dot(offset, offset) <= max_squared:
                first = j if count == selection[0] else first
                second = j if count == selection[1] else second
                count += 1
    return count, (first, second)


@compiled_in_place
def _add_hypotheses(
    xyz: Floats, normals: Floats, rows: tuple[int, int, int], hypotheses: _Hypotheses
) -> None:
    a, n = row_of(xyz, rows[0]), row_of(normals, rows[0])
    m, o = _oriented(row_of(normals, rows[1]), n), _oriented(row_of(normals, rows[2]), n)
    offset, normal_change = add_multiple(a, -1.0, row_of(xyz, rows[1])), add_multiple(n, -1.0, m)
    if dot(normal_change, normal_change) < _MIN_BEND:
        return
    for kind in (SPHERE, CONE):
        axis = (0.0, 0.0, 1.0)
        if kind == CONE:
            direction = cross(n, m)
            if length(direction) == 0.0:
                continue
            axis = multiply(1 / length(direction), direction)
            offset = add_multiple(offset, -dot(offset, axis), axis)
        radius = dot(offset, normal_change) / dot(normal_change, normal_change)
        if length(add_multiple(offset, -radius, normal_change)) < 2 * hypotheses.tolerance:
            origin = add_multiple(a, -radius, n)
            _add_hypothesis(kind, origin, axis, abs(radius), 0.0, hypotheses)
    _add_cone(xyz, rows, (n, m, o), hypotheses)


@compiled_in_place
def _add_cone(
    xyz: Floats,
    rows: tuple[int, int, int],
    normals: tuple[Vector, Vector, Vector],
    hypotheses: _Hypotheses,
) -> None:
    n, m, o = normals
    a, b, c = row_of(xyz, rows[0]), row_of(xyz, rows[1]), row_of(xyz, rows[2])
    axis = cross(add_multiple(n, -1.0, m), add_multiple(n, -1.0, o))
    volume = dot(n, cross(m, o))
    if length(axis) < _MIN_AXIS_LENGTH or abs(volume) < _MIN_VOLUME:
        return
    apex = multiply(dot(n, a) / volume, cross(m, o))
    apex = add_multiple(apex, dot(m, b) / volume, cross(o, n))
    apex = add_multiple(apex, dot(o, c) / volume, cross(n, m))
    centroid = multiply(1 / 3, add_multiple(add_multiple(a, 1.0, b), 1.0, c))
    radial = add_multiple(centroid, -1.0, apex)
    axis = multiply((1 if dot(radial, axis) > 0 else -1) / length(axis), axis)
    height = dot(radial, axis)
    angle = (
        _half_angle(a, apex, axis) + _half_angle(b, apex, axis) + _half_angle(c, apex, axis)
    ) / 3
    if _ANGLES[0] < angle < _ANGLES[1]:
        origin = add_multiple(apex, height, axis)
        _add_hypothesis(CONE, origin, axis, height * np.tan(angle), angle, hypotheses)


@inlined
def _half_angle(point: Vector, apex: Vector, axis: Vector) -> float:
    radial = add_multiple(point, -1.0, apex)
    height = dot(radial, axis)
    return float(np.arctan2(length(add_multiple(radial, -height, axis)), height))


@inlined
def _oriented(normal: Vector, other: Vector) -> Vector:
    return multiply(-1.0 if dot(normal, other) < 0 else 1.0, normal)


@inlined
def _add_hypothesis(
    kind: int,
    origin: Vector,
    axis: Vector,
    radius: float,
    angle: float,
    hypotheses: _Hypotheses,
) -> None:
    if hypotheses.tolerance < radius < hypotheses.max_radius:
        row = hypotheses.fields[hypotheses.size[0]]
        row[0], row[7], row[8] = kind, radius, angle
        for k in range(3):
            row[1 + k], row[4 + k] = origin[k], axis[k]
        hypotheses.size[0] += 1

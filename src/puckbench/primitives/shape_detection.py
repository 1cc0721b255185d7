"""Detection of cylinders, cones and spheres among the smoothed samples of a surface.

Hypotheses from two or three samples with normals are scored by their inliers, as in the RANSAC of
Schnabel, Wahl and Klein (2007), but at equal steps instead of at random: it is deterministic.
"""

from __future__ import annotations

from math import tan

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled, compiled_in_place
from puckbench.geometry.cloud import Floats
from puckbench.primitives.distortion import subset
from puckbench.primitives.octree_arrays import Ints
from puckbench.primitives.revolution import SPHERE, RevolutionSurface, distance_to
from puckbench.primitives.revolution_fit import fit_revolution
from puckbench.primitives.revolution_hypotheses import (
    SPANS,
    blocks_around,
    hypotheses_through,
    hypothesis,
)
from puckbench.primitives.smoothing import BlockedSamples, runs_near

_MAX_SEEDS = 300
_MAX_SCORED = 1200
_MAX_FITTED = 400
_MAX_SURFACES = 16
_MAX_TRIALS = 24
_MIN_CURVED_SHARE = 0.03
"""Share of the samples that have to lie where a surface bends."""
_MIN_SCORE = 5
"""Inliers of a hypothesis that no earlier one has, at least."""
_MIN_INLIERS = 48
"""Samples that a surface has to explain."""
_MIN_COVERAGE = 0.35
"""Share of the area between a surface's ends that has to hold samples."""
_CURVED_COSINES = (0.8, 0.985)
"""Cosines of the angle between neighbours' normals on a curved surface without an edge."""
_MIN_NORMAL_COSINE = 0.96
_MIN_TOLERANCE = 0.35
"""Distance of an inlier of a hypothesis, in sampling cells, at least: three normals are noisy."""
_NEIGHBOURS = 24
"""Nearest samples, with the sample itself, that tell whether the surface bends there."""

Mask = NDArray[np.bool_]


def detect_revolutions(
    xyz: Floats, normals: Floats, cell: float, tolerance: float
) -> list[RevolutionSurface]:
    """Find the surfaces of revolution that explain many samples, those with most samples first.

    Parameters
    ----------
    xyz, normals
        Samples (n, 3) and their unit normals.
    cell
        Spacing of the samples.
    tolerance
        Largest distance of an inlier.

    Returns
    -------
    list of RevolutionSurface
        Bounded surfaces, fitted by robust least squares.
    """
    curved = _curved_samples(xyz, normals, cell)
    if len(curved) < max(_MIN_INLIERS, _MIN_CURVED_SHARE * len(xyz)):
        return []
    # Things much larger than the distance of neighbours bend too little to be found by that.
    seeds = [subset(rows, _MAX_SEEDS) for rows in (curved, np.arange(len(xyz)))]
    loose = max(tolerance, _MIN_TOLERANCE * cell)
    hypotheses = hypotheses_through(xyz, normals, np.concatenate(seeds), cell, loose)
    scored = subset(xyz, _MAX_SCORED), subset(normals, _MAX_SCORED)
    inliers = np.empty((len(hypotheses), len(scored[0])), np.bool_)
    _find_inliers_of_all(hypotheses, *scored, loose, inliers)
    return _select(hypotheses, inliers, xyz, normals, cell, (loose, tolerance))


def bounded_inliers(
    surface: RevolutionSurface, xyz: Floats, normals: Floats, tolerance: float
) -> Mask:
    """Mask (n,) of the samples that lie on a surface between its ends."""
    inliers = _inliers(surface, xyz, normals, tolerance)
    arc_length = surface.coordinates(xyz[inliers])[0]
    inliers[inliers] = (arc_length >= surface.first_row - 1) & (
        arc_length <= surface.first_row + surface.rows + 1
    )
    return inliers


def _curved_samples(xyz: Floats, normals: Floats, cell: float) -> Ints:
    """Samples whose normal differs from that of a neighbour, by less than at an edge.

    Neighbours are the nearest ones, `_NEIGHBOURS` with the sample itself, within a few cells.
    """
    radius = SPANS[0] * cell
    order, blocked = blocks_around(xyz, radius)
    curved = np.zeros(len(xyz), np.bool_)
    _find_curved(blocked, normals[order], radius, curved)
    return np.sort(order[curved])


@compiled
def _find_curved(blocked: BlockedSamples, normals: Floats, radius: float, curved: Mask) -> None:
    """Write which samples, in blocks as large as the radius, are curved.

    The nearest sample with a normal that differs has to have few samples that are nearer.
    """
    xyz = blocked.xyz
    runs = np.empty((9, 2), np.int64)
    for block in range(len(blocked.starts) - 1):
        begin, end = blocked.starts[block], blocked.starts[block + 1]
        if begin == end:
            continue
        found = runs_near(blocked, block, 1, runs)
        for i in range(begin, end):
            nearest = _nearest_bend(xyz, normals, i, found, radius)
            if nearest < radius * radius:
                nearer = 0
                for k in range(len(found)):
                    for j in range(found[k, 0], found[k, 1]):
                        nearer += _squared_distance(xyz, i, j) < nearest
                curved[i] = nearer < _NEIGHBOURS


@compiled_in_place
def _nearest_bend(xyz: Floats, normals: Floats, i: int, runs: Ints, radius: float) -> float:
    """Squared distance of the nearest sample whose normal differs; that of the radius for none."""
    nearest = radius * radius
    for k in range(len(runs)):
        for j in range(runs[k, 0], runs[k, 1]):
            squared = _squared_distance(xyz, i, j)
            if squared < nearest:
                cosine = 0.0
                for a in range(3):
                    cosine += normals[i, a] * normals[j, a]
                if _CURVED_COSINES[0] < abs(cosine) < _CURVED_COSINES[1]:
                    nearest = squared
    return nearest


@compiled_in_place
def _squared_distance(xyz: Floats, i: int, j: int) -> float:
    x, y, z = xyz[i, 0] - xyz[j, 0], xyz[i, 1] - xyz[j, 1], xyz[i, 2] - xyz[j, 2]
    return float(x * x + y * y + z * z)


def _inliers(surface: RevolutionSurface, xyz: Floats, normals: Floats, tolerance: float) -> Mask:
    """Mask (n,) of the samples on a surface, wherever it ends, that share its normal."""
    inliers = np.empty(len(xyz), np.bool_)
    _find_inliers(surface, xyz, normals, tolerance, inliers)
    return inliers


@compiled
def _find_inliers(
    surface: RevolutionSurface, xyz: Floats, normals: Floats, tolerance: float, inliers: Mask
) -> None:
    """Write which samples are near a surface and share its normal."""
    sine, cosine = np.sin(surface.angle), np.cos(surface.angle)
    for i in range(len(xyz)):
        distance, height, radius = distance_to(surface, sine, cosine, xyz[i])
        inliers[i] = False
        if abs(distance) < tolerance:
            along = outwards = 0.0
            for a in range(3):
                along += normals[i, a] * surface.axis[a]
                outwards += normals[i, a] * (xyz[i, a] - surface.origin[a])
            if surface.kind == SPHERE:
                product = outwards / max(np.sqrt(radius * radius + height * height), 1e-9)
            else:
                across = (outwards - height * along) / max(radius, 1e-9)
                product = across * cosine - along * sine
            inliers[i] = abs(product) > _MIN_NORMAL_COSINE


@compiled
def _find_inliers_of_all(
    hypotheses: Floats, xyz: Floats, normals: Floats, tolerance: float, inliers: Mask
) -> None:
    """Write which samples (n,) are inliers of which hypotheses (m, 9)."""
    for k in range(len(hypotheses)):
        _find_inliers(hypothesis(hypotheses[k]), xyz, normals, tolerance, inliers[k])


def _select(
    hypotheses: Floats,
    inliers: Mask,
    xyz: Floats,
    normals: Floats,
    cell: float,
    tolerances: tuple[float, float],
) -> list[RevolutionSurface]:
    """Greedily select and refine the hypotheses that explain most of the remaining samples.

    tolerances: distances of an inlier of a hypothesis, and of a fitted surface.
    """
    tolerance = tolerances[1]
    counts, unexplained = inliers.sum(axis=1), np.ones(inliers.shape[1], bool)
    free = np.ones(len(xyz), bool)
    found: list[RevolutionSurface] = []
    for _ in range(_MAX_TRIALS):
        if len(found) == _MAX_SURFACES or counts.max(initial=0) < _MIN_SCORE:
            break
        best = int(counts.argmax())
        explained = unexplained & inliers[best]
        counts -= inliers[:, explained].sum(axis=1)
        unexplained &= ~explained
        refined = _refine(hypothesis(hypotheses[best]), xyz, normals, free, tolerances)
        refined = clip_to_inliers(refined, xyz, normals, free, tolerance)
        rows = free & bounded_inliers(refined, xyz, normals, tolerance)
        if rows.sum() >= _MIN_INLIERS and _coverage(refined, xyz[rows], cell) > _MIN_COVERAGE:
            free &= ~rows
            found.append(refined)
    return found


def _refine(
    surface: RevolutionSurface,
    xyz: Floats,
    normals: Floats,
    free: Mask,
    tolerances: tuple[float, float],
) -> RevolutionSurface:
    """Robust least-squares fits of a surface to its inliers, each to nearer ones than the last.

    So a surface that crosses between two others ends on one of them.
    """
    for tolerance in (*tolerances, tolerances[1] / 2):
        rows = np.flatnonzero(free & _inliers(surface, xyz, normals, tolerance))
        if len(rows) < 12:
            return surface
        near = xyz[subset(rows, _MAX_FITTED)]
        base = surface._replace(origin=_foot_of_mean(surface, near))
        base = base._replace(radius=_radius_at(surface, base.origin))
        surface = fit_revolution(base, near, tolerance / 2)
    return surface


def _foot_of_mean(surface: RevolutionSurface, near: Floats) -> Floats:
    """The foot of the samples' mean on the axis, or a sphere's centre."""
    if surface.kind == SPHERE:
        return surface.origin
    height = _height(surface, near.mean(axis=0))
    return np.asarray(surface.origin + height * surface.axis)


def _radius_at(surface: RevolutionSurface, origin: Floats) -> float:
    """Radius of a cone where its axis passes `origin`."""
    return surface.radius + _height(surface, origin) * tan(surface.angle)


def _height(surface: RevolutionSurface, point: Floats) -> float:
    """Height of a point (3,) along the axis over the origin."""
    return float(((point - surface.origin) * surface.axis).sum())


def clip_to_inliers(
    surface: RevolutionSurface, xyz: Floats, normals: Floats, free: Mask, tolerance: float
) -> RevolutionSurface:
    """A surface that ends where its free inliers do; without rows for too few of them."""
    inliers = free & _inliers(surface, xyz, normals, tolerance)
    if inliers.sum() < _MIN_INLIERS / 2:
        return surface._replace(rows=0)
    low, high = np.quantile(surface.coordinates(xyz[inliers])[0], [0.01, 0.99])
    first_row = int(np.floor(low))
    return surface._replace(first_row=first_row, rows=min(int(np.ceil(high)) - first_row, 4000))


def _coverage(surface: RevolutionSurface, xyz: Floats, cell: float) -> float:
    """Share of the patches of two sampling cells between a surface's ends that hold samples."""
    arc_length, azimuth, _, _ = surface.coordinates(xyz)
    size = 2 * max(cell, 1.0)
    radius = surface.profile(arc_length)[0]
    rows = ((arc_length - surface.first_row) / size).astype(np.int64)
    columns = (azimuth * radius / size).astype(np.int64)
    area = float(surface.columns().sum()) / size**2
    return len(np.unique(np.stack([rows, columns]), axis=1).T) / max(area, 1.0)

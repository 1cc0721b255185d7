"""Detection of cylinders, cones and spheres among the smoothed samples of a surface.

Hypotheses from two or three samples with normals are scored by their inliers, as in the RANSAC of
Schnabel, Wahl and Klein (2007), but at equal steps instead of at random: it is deterministic.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.primitives.octree_arrays import Ints
from puckbench.codecs.primitives.revolution import (
    CONE,
    SPHERE,
    RevolutionSurface,
    cross,
    distance_to,
    orthogonal_axes,
)
from puckbench.codecs.primitives.smoothing import BlockedSamples, Samples, blocks_of, runs_near
from puckbench.core.compiling import compiled, compiled_in_place
from puckbench.geometry.cloud import Floats

_MAX_SEEDS = 300
_MAX_SCORED = 1200
_MAX_FITTED = 400
_MAX_SURFACES = 16
_STEP = float(np.sqrt(np.finfo(np.float64).eps))
"""Step of a derivative, in the larger of the perturbation and 1."""
_MAX_TRIALS = 24
_MIN_CURVED_SHARE = 0.03
"""Share of the samples that have to lie where a surface bends."""
_MIN_INLIERS = 48
"""Samples that a surface has to explain."""
_MIN_COVERAGE = 0.35
"""Share of the area between a surface's ends that has to hold samples."""
_CURVED_COSINES = (0.8, 0.985)
"""Cosines of the angle between neighbours' normals on a curved surface without an edge."""
_MIN_NORMAL_COSINE = 0.96
_NEIGHBOURS = 24
"""Nearest samples, with the sample itself, that tell whether the surface bends there."""
_SPANS = (3.0, 6.0, 12.0)
"""Distances of the samples of a hypothesis, in sampling cells."""

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
    from scipy.spatial import cKDTree

    curved = _curved_samples(xyz, normals, cell)
    if len(curved) < max(_MIN_INLIERS, _MIN_CURVED_SHARE * len(xyz)):
        return []
    tree = cKDTree(xyz, balanced_tree=False, compact_nodes=False)
    scored = curved[:: -(-len(curved) // _MAX_SCORED)]
    hypotheses = _hypotheses(
        tree, xyz, normals, curved[:: -(-len(curved) // _MAX_SEEDS)], cell, tolerance
    )
    inliers = [
        _inliers(hypothesis, xyz[scored], normals[scored], tolerance) for hypothesis in hypotheses
    ]
    if not inliers:
        return []
    return _select(hypotheses, np.stack(inliers), xyz, normals, cell, tolerance)


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
    radius = _SPANS[0] * cell
    cells = np.floor(xyz / radius).astype(np.int64)
    order, blocked = blocks_of(Samples(xyz, np.ones(len(xyz)), cells), 1)
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


def _hypotheses(
    tree: Any, xyz: Floats, normals: Floats, seeds: Ints, cell: float, tolerance: float
) -> list[RevolutionSurface]:
    """Surfaces through two or three samples and their normals."""
    hypotheses: list[RevolutionSurface] = []
    largest = float(np.ptp(xyz, axis=0).max()) / 2
    for k, span in enumerate(_SPANS):
        for row, near in zip(seeds, tree.query_ball_point(xyz[seeds], span * cell), strict=True):
            others = np.array(near)
            away = np.linalg.norm(xyz[others] - xyz[row], axis=1)
            others = others[away > 0.6 * span * cell]
            if len(others) < 2:
                continue
            rows = np.array([row, others[(7 * k + 3) % len(others)], others[len(others) // 2]])
            sides = np.where(normals[rows] @ normals[row] < 0, -1.0, 1.0)
            hypotheses += _through_samples(xyz[rows], normals[rows] * sides[:, None], tolerance)
    return [hypothesis for hypothesis in hypotheses if tolerance < hypothesis.radius < largest]


def _through_samples(xyz: Floats, normals: Floats, tolerance: float) -> list[RevolutionSurface]:
    """The sphere and the cylinder through the first two samples, the cone through three."""
    hypotheses = []
    normal_difference, difference = normals[0] - normals[1], xyz[0] - xyz[1]
    if normal_difference @ normal_difference < 1e-4:
        return []
    radius = float(difference @ normal_difference / (normal_difference @ normal_difference))
    if np.linalg.norm(difference - radius * normal_difference) < 2 * tolerance:
        hypotheses.append(
            _unbounded(SPHERE, xyz[0] - radius * normals[0], np.eye(3)[2], abs(radius), 0.0)
        )
    axis = cross(normals[0], normals[1])
    axis /= np.linalg.norm(axis)
    in_plane = difference - (difference @ axis) * axis
    radius = float(in_plane @ normal_difference / (normal_difference @ normal_difference))
    if np.linalg.norm(in_plane - radius * normal_difference) < 2 * tolerance:
        hypotheses.append(_unbounded(CONE, xyz[0] - radius * normals[0], axis, abs(radius), 0.0))
    return hypotheses + _cone(xyz, normals)


def _cone(xyz: Floats, normals: Floats) -> list[RevolutionSurface]:
    """The cone whose tangent planes at three samples are those of the samples."""
    axis = cross(normals[0] - normals[1], normals[0] - normals[2])
    if np.linalg.norm(axis) < 0.02 or abs(np.linalg.det(normals)) < 1e-3:
        return []
    axis /= np.linalg.norm(axis)
    apex = np.linalg.solve(normals, np.einsum("ij,ij->i", normals, xyz))
    middle = xyz.mean(axis=0)
    axis = axis if (middle - apex) @ axis > 0 else -axis
    height = float((middle - apex) @ axis)
    radius = float(np.linalg.norm(middle - apex - height * axis))
    angle = float(np.arctan2(radius, height))
    if not 0.02 < angle < 1.3:
        return []
    return [_unbounded(CONE, apex + height * axis, axis, radius, angle)]


def _unbounded(
    kind: int, origin: Floats, axis: Floats, radius: float, angle: float
) -> RevolutionSurface:
    """A surface without ends yet."""
    return RevolutionSurface(kind, origin, axis, radius, angle, 0, 0)


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


def _select(
    hypotheses: list[RevolutionSurface],
    inliers: Mask,
    xyz: Floats,
    normals: Floats,
    cell: float,
    tolerance: float,
) -> list[RevolutionSurface]:
    """Greedily select and refine the hypotheses that explain most of the remaining samples."""
    unexplained, free = np.ones(inliers.shape[1], bool), np.ones(len(xyz), bool)
    found: list[RevolutionSurface] = []
    for _ in range(_MAX_TRIALS):
        counts = (inliers & unexplained).sum(axis=1)
        best = int(counts.argmax())
        if len(found) == _MAX_SURFACES or counts[best] < 5:
            break
        unexplained &= ~inliers[best]
        refined = _refine(hypotheses[best], xyz, normals, free, tolerance)
        refined = clip_to_inliers(refined, xyz, normals, free, tolerance)
        rows = free & bounded_inliers(refined, xyz, normals, tolerance)
        if rows.sum() >= _MIN_INLIERS and _coverage(refined, xyz[rows], cell) > _MIN_COVERAGE:
            free &= ~rows
            found.append(refined)
    return found


def _refine(
    surface: RevolutionSurface, xyz: Floats, normals: Floats, free: Mask, tolerance: float
) -> RevolutionSurface:
    """Robust least-squares fit of a surface to its inliers."""
    from scipy.optimize import least_squares

    search = partial(
        least_squares,
        _distances,
        jac=_derivatives,
        loss="soft_l1",
        f_scale=tolerance / 2,
        max_nfev=15,
    )
    for _ in range(2):
        rows = np.flatnonzero(free & _inliers(surface, xyz, normals, tolerance))
        if len(rows) < 12:
            return surface
        near = xyz[rows[:: -(-len(rows) // _MAX_FITTED)]]
        base = surface._replace(origin=_foot_of_mean(surface, near))
        base = base._replace(radius=_radius_at(surface, base.origin))
        fitted = (base, np.stack(orthogonal_axes(base.axis)), near)
        surface = _perturbed(search(np.zeros(7), args=fitted).x, *fitted[:2])
    return surface


@compiled
def _distances(
    perturbation: Floats, surface: RevolutionSurface, across: Floats, xyz: Floats
) -> Floats:
    """Distances (n,) of points (n, 3) from a surface that is perturbed as by `_perturbed`."""
    perturbed = _perturbed(perturbation, surface, across)
    sine, cosine = np.sin(perturbed.angle), np.cos(perturbed.angle)
    distances = np.empty(len(xyz))
    for i in range(len(xyz)):
        distances[i] = distance_to(perturbed, sine, cosine, xyz[i])[0]
    return distances


@compiled
def _derivatives(
    perturbation: Floats, surface: RevolutionSurface, across: Floats, xyz: Floats
) -> Floats:
    """Derivatives (n, 7) of `_distances` by the perturbations, as differences of small steps."""
    distances = _distances(perturbation, surface, across, xyz)
    derivatives = np.empty((len(perturbation), len(xyz)))
    for k in range(len(perturbation)):
        moved = perturbation.copy()
        step = _STEP * max(abs(moved[k]), 1.0)
        moved[k] += step if moved[k] >= 0 else -step
        difference = _distances(moved, surface, across, xyz) - distances
        derivatives[k] = difference / (moved[k] - perturbation[k])
    return derivatives.T


def _foot_of_mean(surface: RevolutionSurface, near: Floats) -> Floats:
    """The foot of the samples' mean on the axis, or a sphere's centre."""
    if surface.kind == SPHERE:
        return surface.origin
    height = float((near.mean(axis=0) - surface.origin) @ surface.axis)
    return np.asarray(surface.origin + height * surface.axis)


def _radius_at(surface: RevolutionSurface, origin: Floats) -> float:
    """Radius of a cone where its axis passes `origin`."""
    height = float((origin - surface.origin) @ surface.axis)
    return surface.radius + height * float(np.tan(surface.angle))


@compiled
def _perturbed(
    perturbation: Floats, surface: RevolutionSurface, across: Floats
) -> RevolutionSurface:
    """A surface with seven small perturbations: origin (3), axis (2), radius, angle.

    across: (2, 3) unit vectors orthogonal to the axis and to each other.
    """
    origin = surface.origin + perturbation[:3]
    radius, axis, angle = surface.radius + perturbation[5], surface.axis, surface.angle
    if surface.kind != SPHERE:
        axis = axis + (perturbation[3] * across[0] + perturbation[4] * across[1]) / 100
        axis = axis / np.sqrt((axis * axis).sum())
        angle += perturbation[6] / 100
    return RevolutionSurface(
        surface.kind, origin, axis, radius, angle, surface.first_row, surface.rows
    )


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

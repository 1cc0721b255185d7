"""Detection of cylinders, cones and spheres in the smoothed samples of a surface.

Hypotheses from two or three samples with normals are scored by their inliers, as in the RANSAC of
Schnabel, Wahl and Klein (2007). Here the first sample of a hypothesis is not random; every k-th
sample is used.
"""

from __future__ import annotations

from math import tan

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled, compiled_in_place
from pointkit.geometry.cloud import Floats
from primitive_codec.distortion import subsample
from primitive_codec.octree_arrays import Ints
from primitive_codec.revolution import SPHERE, RevolutionSurface, distance_to
from primitive_codec.revolution_fit import fit_revolution
from primitive_codec.revolution_hypotheses import (
    SPANS,
    block_samples,
    make_hypotheses,
    surface_of_hypothesis,
)
from primitive_codec.smoothing import BlockedSamples, ranges_near

_MAX_SEEDS = 300
_MAX_SCORED = 1200
_MAX_FITTED = 400
_MAX_SURFACES = 16
_MAX_TRIALS = 24
_MIN_CURVED_SHARE = 0.03
"""Fraction of curved samples below which detection is skipped."""
_MIN_NEW_INLIERS = 5
"""Least number of a hypothesis's inliers that no earlier hypothesis has."""
_MIN_INLIERS = 48
_MIN_COVERAGE = 0.35
"""Least fraction of a bounded surface's area that samples cover."""
_CURVED_COSINES = (0.8, 0.985)
"""Range of cosines between neighbours' normals on a curved surface; smaller cosines are edges."""
_MIN_INLIER_COSINE = 0.96
_MIN_TOLERANCE = 0.35
"""Least inlier tolerance of a hypothesis, in sampling cells, because normals are noisy."""
_NEIGHBOURS = 24
"""Number of a sample's neighbours, itself included, whose normals decide if it is curved."""

Mask = NDArray[np.bool_]


def detect_revolutions(
    xyz: Floats, normals: Floats, spacing: float, tolerance: float
) -> list[RevolutionSurface]:
    """Detect cylinders, cones and spheres in the samples of a surface.

    Parameters
    ----------
    xyz, normals
        Samples of the surface and their unit normals (n, 3).
    spacing
        Distance between adjacent samples.
    tolerance
        Largest distance of an inlier from a detected surface.

    Returns
    -------
    list of RevolutionSurface
        The detected surfaces, at most 16, with ends that follow from their inliers. Surfaces with
        the most inliers come first.
    """
    curved = _curved_samples(xyz, normals, spacing)
    if len(curved) < max(_MIN_INLIERS, _MIN_CURVED_SHARE * len(xyz)):
        return []
    # Surfaces with large radii bend too little between neighbours, so all samples are seeds too.
    seeds = [subsample(rows, _MAX_SEEDS) for rows in (curved, np.arange(len(xyz)))]
    loose_tolerance = max(tolerance, _MIN_TOLERANCE * spacing)
    hypotheses = make_hypotheses(xyz, normals, np.concatenate(seeds), spacing, loose_tolerance)
    scored = subsample(xyz, _MAX_SCORED), subsample(normals, _MAX_SCORED)
    inliers = _inliers_of_all(hypotheses, *scored, loose_tolerance)
    return _select(hypotheses, inliers, xyz, normals, spacing, (loose_tolerance, tolerance))


def bounded_inliers(
    surface: RevolutionSurface, xyz: Floats, normals: Floats, tolerance: float
) -> Mask:
    """Return a mask (n,) of the samples that lie on a surface, between its two ends."""
    inliers = _inliers(surface, xyz, normals, tolerance)
    arc_length = surface.coordinates(xyz[inliers])[0]
    inliers[inliers] = (arc_length >= surface.first_row - 1) & (
        arc_length <= surface.first_row + surface.row_count + 1
    )
    return inliers


def _curved_samples(xyz: Floats, normals: Floats, spacing: float) -> Ints:
    radius = SPANS[0] * spacing
    order, blocked = block_samples(xyz, radius)
    curved = np.zeros(len(xyz), np.bool_)
    _find_curved(blocked, normals[order], radius, curved)
    return np.sort(order[curved])


@compiled
def _find_curved(blocked: BlockedSamples, normals: Floats, radius: float, curved: Mask) -> None:
    xyz = blocked.xyz
    ranges = np.empty((9, 2), np.int64)
    for block in range(len(blocked.starts) - 1):
        begin, end = blocked.starts[block], blocked.starts[block + 1]
        if begin == end:
            continue
        near_ranges = ranges_near(blocked, block, 1, ranges)
        for i in range(begin, end):
            squared_bend = _nearest_bend(xyz, normals, i, near_ranges, radius)
            if squared_bend < radius * radius:
                nearer_count = 0
                for k in range(len(near_ranges)):
                    for j in range(near_ranges[k, 0], near_ranges[k, 1]):
                        nearer_count += _squared_distance(xyz, i, j) < squared_bend
                curved[i] = nearer_count < _NEIGHBOURS


@compiled_in_place
def _nearest_bend(xyz: Floats, normals: Floats, i: int, ranges: Ints, radius: float) -> float:
    """Return the squared distance to the nearest sample with a normal 10 to 37 degrees off."""
    # Without such a sample, return radius^2.
    squared_bend = radius * radius
    for k in range(len(ranges)):
        for j in range(ranges[k, 0], ranges[k, 1]):
            squared = _squared_distance(xyz, i, j)
            if squared < squared_bend:
                cosine = 0.0
                for a in range(3):
                    cosine += normals[i, a] * normals[j, a]
                if _CURVED_COSINES[0] < abs(cosine) < _CURVED_COSINES[1]:
                    squared_bend = squared
    return squared_bend


@compiled_in_place
def _squared_distance(xyz: Floats, i: int, j: int) -> float:
    x, y, z = xyz[i, 0] - xyz[j, 0], xyz[i, 1] - xyz[j, 1], xyz[i, 2] - xyz[j, 2]
    return float(x * x + y * y + z * z)


@compiled
def _inliers(surface: RevolutionSurface, xyz: Floats, normals: Floats, tolerance: float) -> Mask:
    inliers = np.zeros(len(xyz), np.bool_)
    sine, cosine = np.sin(surface.angle), np.cos(surface.angle)
    for i in range(len(xyz)):
        distance, height, radius = distance_to(surface, sine, cosine, xyz[i])
        if abs(distance) < tolerance:
            axial = radial = 0.0
            for a in range(3):
                axial += normals[i, a] * surface.axis[a]
                radial += normals[i, a] * (xyz[i, a] - surface.origin[a])
            if surface.kind == SPHERE:
                product = radial / max(np.sqrt(radius * radius + height * height), 1e-9)
            else:
                perpendicular = (radial - height * axial) / max(radius, 1e-9)
                product = perpendicular * cosine - axial * sine
            inliers[i] = abs(product) > _MIN_INLIER_COSINE
    return inliers


@compiled
def _inliers_of_all(hypotheses: Floats, xyz: Floats, normals: Floats, tolerance: float) -> Mask:
    inliers = np.empty((len(hypotheses), len(xyz)), np.bool_)
    for k in range(len(hypotheses)):
        inliers[k] = _inliers(surface_of_hypothesis(hypotheses[k]), xyz, normals, tolerance)
    return inliers


def _select(
    hypotheses: Floats,
    inliers: Mask,
    xyz: Floats,
    normals: Floats,
    spacing: float,
    tolerances: tuple[float, float],
) -> list[RevolutionSurface]:
    """Repeatedly refine the hypothesis with the most inliers that no earlier hypothesis has."""
    tolerance = tolerances[1]
    counts, unexplained = inliers.sum(axis=1), np.ones(inliers.shape[1], bool)
    unassigned = np.ones(len(xyz), bool)
    surfaces: list[RevolutionSurface] = []
    for _ in range(_MAX_TRIALS):
        if len(surfaces) == _MAX_SURFACES or counts.max(initial=0) < _MIN_NEW_INLIERS:
            break
        best = int(counts.argmax())
        explained = unexplained & inliers[best]
        counts -= inliers[:, explained].sum(axis=1)
        unexplained &= ~explained
        refined = _refine(
            surface_of_hypothesis(hypotheses[best]), xyz, normals, unassigned, tolerances
        )
        refined = clip_to_inliers(refined, xyz, normals, unassigned, tolerance)
        rows = unassigned & bounded_inliers(refined, xyz, normals, tolerance)
        if rows.sum() >= _MIN_INLIERS and _coverage(refined, xyz[rows], spacing) > _MIN_COVERAGE:
            unassigned &= ~rows
            surfaces.append(refined)
    return surfaces


def _refine(
    surface: RevolutionSurface,
    xyz: Floats,
    normals: Floats,
    unassigned: Mask,
    tolerances: tuple[float, float],
) -> RevolutionSurface:
    """Fit a surface to its inliers repeatedly, each time with a smaller tolerance."""
    # Smaller tolerances let a hypothesis between two surfaces converge to one of them.
    for tolerance in (*tolerances, tolerances[1] / 2):
        rows = np.flatnonzero(unassigned & _inliers(surface, xyz, normals, tolerance))
        if len(rows) < 12:
            return surface
        samples = xyz[subsample(rows, _MAX_FITTED)]
        origin = surface.origin
        if surface.kind != SPHERE:
            origin = origin + _height(surface, samples.mean(axis=0)) * surface.axis
        radius = surface.radius + _height(surface, origin) * tan(surface.angle)
        start = surface._replace(origin=origin, radius=radius)
        surface = fit_revolution(start, samples, tolerance / 2)
    return surface


def _height(surface: RevolutionSurface, point: Floats) -> float:
    return float(((point - surface.origin) * surface.axis).sum())


def clip_to_inliers(
    surface: RevolutionSurface, xyz: Floats, normals: Floats, unassigned: Mask, tolerance: float
) -> RevolutionSurface:
    """Set the ends of a surface to the range of nearly all of its inliers.

    Parameters
    ----------
    surface
        Surface with any ends.
    xyz, normals
        Samples and their unit normals (n, 3).
    unassigned
        Mask (n,) of the samples that may be inliers.
    tolerance
        Largest distance of an inlier.

    Returns
    -------
    RevolutionSurface
        The surface with ends; it has no rows if there are too few inliers.
    """
    inliers = unassigned & _inliers(surface, xyz, normals, tolerance)
    if inliers.sum() < _MIN_INLIERS / 2:
        return surface._replace(row_count=0)
    first, last = np.quantile(surface.coordinates(xyz[inliers])[0], [0.01, 0.99])
    first_row = int(np.floor(first))
    return surface._replace(
        first_row=first_row, row_count=min(int(np.ceil(last)) - first_row, 4000)
    )


def _coverage(surface: RevolutionSurface, xyz: Floats, spacing: float) -> float:
    """Return the fraction of a surface's patches, two spacings wide, that contain samples."""
    arc_length, azimuth, _, _ = surface.coordinates(xyz)
    size = 2 * max(spacing, 1.0)
    radius = surface.profile(arc_length)[0]
    rows = ((arc_length - surface.first_row) / size).astype(np.int64)
    columns = (azimuth * radius / size).astype(np.int64)
    area = surface.column_count() / size**2
    return len(np.unique(np.stack([rows, columns]), axis=1).T) / max(area, 1.0)

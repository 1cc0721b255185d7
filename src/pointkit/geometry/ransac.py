"""Planes through points: by RANSAC, by least squares, and by repeated fits without outliers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats

THRESHOLD_M = 0.01
# Largest number of samples and confidence: PCL's defaults.
_MAX_SAMPLES, _CONFIDENCE = 1000, 0.99
_SAMPLES_PER_BATCH, _POINTS_PER_BATCH = 32, 1 << 14
# Keeps all points of an exact plane as inliers despite rounding.
_MIN_STD_M = 1e-9


@dataclass(frozen=True)
class Plane:
    """A plane: the points x with ``normal @ x == offset``, where the normal has length 1."""

    normal: Floats
    offset: float

    def distances(self, points: Floats) -> Floats:
        """Return the signed distances (n,) of points; they are positive on the normal's side."""
        return np.asarray(points @ self.normal - self.offset)

    def facing(self, point: Floats) -> Plane:
        """Return the same plane with the normal pointing to the side of a point (3,)."""
        side = -1.0 if self.normal @ point < self.offset else 1.0
        return Plane(self.normal * side, self.offset * side)


def ransac_plane(
    points: Floats,
    rng: np.random.Generator,
    *,
    threshold_m: float = THRESHOLD_M,
    refit: bool = False,
) -> Plane:
    """Fit a plane to points by RANSAC, as PCL does (thesis, section 5.1.2).

    At most 1000 samples are drawn, for a confidence of 99 %.

    Parameters
    ----------
    points
        Points, (n, 3), m.
    rng
        Source of the samples.
    threshold_m
        Greatest distance of an inlier from the plane, m.
    refit
        Whether to fit the plane to its inliers by least squares at the end.

    Returns
    -------
    Plane
        The plane with the most inliers.

    Raises
    ------
    InputError
        There are fewer than three points, or all points lie on one line.
    """
    if len(points) < 3:
        raise InputError(f"a plane needs at least 3 points, there are {len(points)}")
    centre = points.mean(axis=0)  # large coordinates would lose digits
    best = _plane_with_most_inliers(points - centre, rng, threshold_m)
    if refit:
        near = np.abs(best.distances(points - centre)) < threshold_m
        best = least_squares_plane((points - centre)[near])
    return Plane(best.normal, float(best.offset + best.normal @ centre))


def least_squares_plane(points: Floats) -> Plane:
    """Return the plane with the least sum of squared distances to points (n, 3)."""
    centre = points.mean(axis=0)
    relative = points - centre
    _, vectors = np.linalg.eigh(relative.T @ relative)
    normal = vectors[:, 0]
    return Plane(normal, float(normal @ centre))


def robust_plane(
    points: Floats, start: Plane, *, sigmas: float = 5.0, rounds: int = 20
) -> tuple[Plane, NDArray[np.bool_]]:
    """Fit a plane repeatedly, each time to those points that are inliers of the previous plane.

    A point is an inlier if its distance is within `sigmas` robust standard deviations of the median
    distance. The fit ends after `rounds` rounds, or when the inliers no longer change.

    Parameters
    ----------
    points
        Points, (n, 3).
    start
        The first plane.
    sigmas
        Greatest deviation of an inlier, in robust standard deviations.
    rounds
        Greatest number of fits.

    Returns
    -------
    tuple of Plane and array
        The last plane, and the mask (n,) of its inliers.
    """
    plane, inliers = start, np.zeros(len(points), dtype=bool)
    for _ in range(rounds):
        distances = plane.distances(points)
        deviations = np.abs(distances - np.median(distances))
        near = deviations <= sigmas * max(robust_std(distances), _MIN_STD_M)
        if np.array_equal(near, inliers):
            break
        plane, inliers = least_squares_plane(points[near]), near
    return plane, inliers


def robust_std(values: Floats) -> float:
    """Estimate the standard deviation of values from their median absolute deviation."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def _plane_with_most_inliers(points: Floats, rng: np.random.Generator, threshold_m: float) -> Plane:
    best, inliers, samples = None, 0, 0
    for normals, offsets in _sampled_planes(points, rng):
        samples += _SAMPLES_PER_BATCH
        counts = _inlier_counts(points, normals, offsets, threshold_m)
        if len(counts) and counts.max() > inliers:
            row = int(counts.argmax())
            best, inliers = Plane(normals[row], float(offsets[row])), int(counts[row])
        if samples >= _samples_needed(inliers / len(points)):
            break
    if best is None:
        raise InputError(f"the {len(points)} points lie on one line: no plane through them")
    return best


def _sampled_planes(points: Floats, rng: np.random.Generator) -> Iterator[tuple[Floats, Floats]]:
    for _ in range(0, _MAX_SAMPLES, _SAMPLES_PER_BATCH):
        a, b, c = points[rng.integers(len(points), size=(3, _SAMPLES_PER_BATCH))]
        normals = np.cross(b - a, c - a)
        lengths = np.linalg.norm(normals, axis=1)
        sides = np.linalg.norm(b - a, axis=1) * np.linalg.norm(c - a, axis=1)
        valid = lengths > 1e-9 * sides
        normals = normals[valid] / lengths[valid, None]
        yield normals, np.sum(normals * a[valid], axis=1)


def _inlier_counts(
    points: Floats, normals: Floats, offsets: Floats, threshold_m: float
) -> NDArray[np.int64]:
    counts = np.zeros(len(normals), dtype=np.int64)
    for first in range(0, len(points), _POINTS_PER_BATCH):
        distances = normals @ points[first : first + _POINTS_PER_BATCH].T - offsets[:, None]
        counts += np.count_nonzero(np.abs(distances) < threshold_m, axis=1)
    return counts


def _samples_needed(share: float) -> float:
    if share in {0.0, 1.0}:
        return 1.0 if share else float("inf")
    return float(np.log(1 - _CONFIDENCE) / np.log1p(-(share**3)))

"""Planes fitted to noisy points by RANSAC, and signed distances to them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

THRESHOLD_M = 0.01
# PCL's own: most samples, and the confidence at which a better one is unlikely.
_MOST_SAMPLES, _CONFIDENCE = 1000, 0.99
_SAMPLES_AT_A_TIME, _POINTS_AT_A_TIME = 32, 1 << 14
# Points that lie exactly on one plane are all kept despite rounding.
_LEAST_SPREAD_M = 1e-9


@dataclass(frozen=True)
class Plane:
    """The points x with ``normal @ x == offset``; `normal` (3,) has length 1."""

    normal: Floats
    offset: float

    def distances(self, points: Floats) -> Floats:
        """Signed distances of points (n, 3), positive on the normal's side, (n,)."""
        return np.asarray(points @ self.normal - self.offset)

    def facing(self, place: Floats) -> Plane:
        """The same plane with its normal on the side of `place` (3,)."""
        side = -1.0 if self.normal @ place < self.offset else 1.0
        return Plane(self.normal * side, self.offset * side)


def ransac_plane(
    points: Floats,
    rng: np.random.Generator,
    *,
    threshold_m: float = THRESHOLD_M,
    refit: bool = False,
) -> Plane:
    """Fit a plane by RANSAC: the plane through three points that most points lie close to.

    As PCL's RandomSampleConsensus, which the thesis's measurements used (section 5.1.2): at most
    1000 samples, fewer once a better plane is unlikely with 99 % confidence, and no refit.

    Parameters
    ----------
    points
        (n, 3), metres.
    rng
        Draws the samples.
    threshold_m
        Largest distance of an inlier from the plane.
    refit
        Return the least-squares plane of the inliers instead. Noise wider than the threshold is cut
        off about the first plane, so its tilt shrinks but remains.

    Raises
    ------
    InputError
        There are fewer than three points, or all lie on one line.
    """
    if len(points) < 3:
        raise InputError(f"a plane needs at least 3 points, there are {len(points)}")
    # Offsets of far points would cost digits.
    centre = points.mean(axis=0)
    best = _most_supported(points - centre, rng, threshold_m)
    if refit:
        near = np.abs(best.distances(points - centre)) < threshold_m
        best = least_squares_plane((points - centre)[near])
    return Plane(best.normal, float(best.offset + best.normal @ centre))


def least_squares_plane(points: Floats) -> Plane:
    """The plane with the least sum of squared distances to `points` (n, 3)."""
    centre = points.mean(axis=0)
    relative = points - centre
    _, vectors = np.linalg.eigh(relative.T @ relative)
    normal = vectors[:, 0]
    return Plane(normal, float(normal @ centre))


def robust_plane(
    points: Floats, start: Plane, *, sigmas: float = 5.0, rounds: int = 20
) -> tuple[Plane, NDArray[np.bool_]]:
    """Least-squares plane of the inliers: fit and selection repeat until the inliers are the same.

    Parameters
    ----------
    points
        (n, 3), metres.
    start
        The plane to begin with.
    sigmas
        Largest distance of an inlier from the median, in robust standard deviations (`robust_std`)
        of all distances.
    rounds
        Most repetitions.

    Returns
    -------
    tuple
        The plane and the mask (n,) of its inliers.
    """
    plane, chosen = start, np.zeros(len(points), dtype=bool)
    for _ in range(rounds):
        distances = plane.distances(points)
        away = np.abs(distances - np.median(distances))
        near = away <= sigmas * max(robust_std(distances), _LEAST_SPREAD_M)
        if np.array_equal(near, chosen):
            break
        plane, chosen = least_squares_plane(points[near]), near
    return plane, chosen


def robust_std(values: Floats) -> float:
    """Standard deviation estimated by the median absolute deviation (exact for a Gaussian)."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def _most_supported(points: Floats, rng: np.random.Generator, threshold_m: float) -> Plane:
    best, support, tried = None, 0, 0
    for normals, offsets in _samples(points, rng):
        tried += _SAMPLES_AT_A_TIME
        counts = _support(points, normals, offsets, threshold_m)
        if len(counts) and counts.max() > support:
            chosen = int(counts.argmax())
            best, support = Plane(normals[chosen], float(offsets[chosen])), int(counts[chosen])
        if tried >= _samples_needed(support / len(points)):
            break
    if best is None:
        raise InputError(f"the {len(points)} points lie on one line: no plane through them")
    return best


def _samples(points: Floats, rng: np.random.Generator) -> Iterator[tuple[Floats, Floats]]:
    """Planes through three random points each, as normals (k, 3) and offsets (k,)."""
    for _ in range(0, _MOST_SAMPLES, _SAMPLES_AT_A_TIME):
        a, b, c = points[rng.integers(len(points), size=(3, _SAMPLES_AT_A_TIME))]
        normals = np.cross(b - a, c - a)
        lengths = np.linalg.norm(normals, axis=1)
        sides = np.linalg.norm(b - a, axis=1) * np.linalg.norm(c - a, axis=1)
        sound = lengths > 1e-9 * sides
        normals = normals[sound] / lengths[sound, None]
        yield normals, np.sum(normals * a[sound], axis=1)


def _support(
    points: Floats, normals: Floats, offsets: Floats, threshold_m: float
) -> NDArray[np.int64]:
    """Number of points within the threshold of each plane, (k,)."""
    counts = np.zeros(len(normals), dtype=np.int64)
    for first in range(0, len(points), _POINTS_AT_A_TIME):
        distances = normals @ points[first : first + _POINTS_AT_A_TIME].T - offsets[:, None]
        counts += np.count_nonzero(np.abs(distances) < threshold_m, axis=1)
    return counts


def _samples_needed(share: float) -> float:
    """Samples after which one of three inliers was drawn with the confidence wanted."""
    if share in {0.0, 1.0}:
        return 1.0 if share else float("inf")
    return float(np.log(1 - _CONFIDENCE) / np.log1p(-(share**3)))

"""PCQM, an error of the look of coloured clouds (Meynet, Nehmé, Digne and Lavoué, QoMEX 2020).

It is the value that the authors' program prints for two clouds without duplicate points whose box
begins at the origin: the program takes the largest coordinate for the length of the box.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled
from pointkit.geometry.cloud import Floats, PointCloud, bounds
from puckbench.metrics.paired_values import distinct_values

Rows = NDArray[np.int64]

NEIGHBOURS = 20
"""Number of neighbours to which the surface is fitted that a point is projected on."""
_RADIUS = 0.004
"""Radius within which curvatures are estimated, relative to the longest side of the box."""
_STATISTICS = 2.0
"""Radius of the local statistics, relative to that of the curvatures."""
_CURVATURE, _LIGHTNESS, _PATTERN = 0.0057, 0.9771, 0.0172
"""Weights of the differences in the structure of curvatures, and in lightness and its structure."""
_QUERIES = 2_000
"""Number of points whose neighbours are held at once."""
_SMALLEST = float(np.finfo(np.float64).eps)


def pcqm(reference: PointCloud, decoded: PointCloud) -> float:
    """Return the PCQM of a decoded cloud, which is 0 for equal clouds, and higher for worse ones.

    Each point of the original is compared with the decoded surface near it: the structure of the
    curvatures, the lightness, and the structure of the lightness. Duplicate points are merged.

    Parameters
    ----------
    reference, decoded
        The original and the decoded cloud, each with colours and at least `NEIGHBOURS` distinct
        points.
    """
    from scipy.spatial import cKDTree

    a, b = (
        distinct_values(cloud.xyz, np.asarray(cloud.colours, np.float64), name)
        for cloud, name in ((reference, "reference cloud"), (decoded, "decoded cloud"))
    )
    longest = float(np.ptp(bounds(a.points), axis=0).max())
    radius = _RADIUS * longest
    a_tree, b_tree = cKDTree(a.points), cKDTree(b.points)
    nearest = np.asarray(b_tree.query(a.points, k=NEIGHBOURS)[1], np.int64)
    projected = _projections(a.points, b.points, nearest)
    bent, other_bent = (
        longest * _curvatures(a.points, tree, points, radius)
        for tree, points in ((a_tree, a.points), (b_tree, b.points))
    )
    light, other_light = lightness(a.values), lightness(b.values)[nearest[:, 0]]
    reach, sums = _STATISTICS * radius, np.zeros(3)
    for first in range(0, len(a.points), _QUERIES):
        starts, rows = _within(a_tree, a.points[first : first + _QUERIES], reach)
        near = (first, starts, rows, a.points, projected)
        sums += _features(*near, bent, other_bent, light, other_light, reach / 2)
    curvature, likeness, pattern = sums / len(a.points)
    return float(_CURVATURE * curvature + _LIGHTNESS * (1 - likeness) + _PATTERN * (1 - pattern))


def lightness(colours: Floats) -> Floats:
    """Return the lightness of sRGB colours (n, 3), from 0 to 255, in LAB2000HL.

    This colour space (Lissner and Urban 2012) makes differences uniform with respect to CIEDE2000:
    its lightness is the integral of 1 / S_L over the lightness L* of CIELAB.
    """
    share = np.asarray(colours, np.float64) / 255
    linear = np.where(share > 0.0404482362771076, ((share + 0.055) / 1.055) ** 2.4, share / 12.92)
    luminance = linear @ np.array([0.212586, 0.71517, 0.0722005])
    cube_root = np.where(luminance > 0.008856, np.cbrt(luminance), 841 / 108 * luminance + 4 / 29)
    return np.asarray(np.interp(116 * cube_root - 16, *_uniform_lightness()))


@cache
def _uniform_lightness() -> tuple[Floats, Floats]:
    """Return values of L* from 0 to 100, and the integral of 1 / S_L up to each."""
    l_star = np.linspace(0, 100, 100_001)
    squared = (l_star - 50) ** 2
    slope = 1 / (1 + 0.015 * squared / np.sqrt(20 + squared))
    steps = (slope[1:] + slope[:-1]) / 2 * np.diff(l_star)
    return l_star, np.append(0.0, np.cumsum(steps))


def _within(tree: Any, queries: Floats, radius: float) -> tuple[Rows, Rows]:
    """Return the points of a tree within a radius of each query.

    The rows of those of query i are ``rows[starts[i]:starts[i + 1]]``.
    """
    lists = tree.query_ball_point(queries, radius, return_sorted=True)
    starts = np.append(0, np.cumsum([len(each) for each in lists]))
    return starts, np.concatenate([np.array(each, np.int64) for each in lists])


def _curvatures(queries: Floats, tree: Any, points: Floats, radius: float) -> Floats:
    """Return the absolute mean curvature of a cloud at each query, from the points near it."""
    parts = []
    for first in range(0, len(queries), _QUERIES):
        part = queries[first : first + _QUERIES]
        parts.append(_curvatures_of(part, points, *_within(tree, part, radius)))
    return np.concatenate(parts)


@compiled
def _curvatures_of(queries: Floats, points: Floats, starts: Rows, rows: Rows) -> Floats:
    curvatures = np.zeros(len(queries))
    for i in range(len(queries)):
        if starts[i] == starts[i + 1]:
            continue
        c, _ = _quadric(queries[i], points, rows[starts[i] : starts[i + 1]])
        xx, yy, xy, x, y = 2 * c[0], 2 * c[1], c[2], c[3], c[4]
        bent = (1 + x * x) * yy + (1 + y * y) * xx - 2 * xy * x * y
        curvatures[i] = abs(0.5 * bent / (1 + x * x + y * y) ** 1.5)
    return curvatures


@compiled
def _projections(queries: Floats, points: Floats, nearest: Rows) -> Floats:
    """Return each query's projection on the surface, or its nearest point if this is nearer."""
    projected = np.empty_like(queries)
    for i in range(len(queries)):
        coefficients, normal = _quadric(queries[i], points, nearest[i])
        offset = points[nearest[i, 0]] - queries[i]
        if coefficients[5] ** 2 <= np.sum(offset**2):
            offset = coefficients[5] * normal
        projected[i] = queries[i] + offset
    return projected


@compiled
def _quadric(origin: Floats, points: Floats, rows: Rows) -> tuple[Floats, Floats]:
    """Fit a quadric z(x, y) to some points, with `origin` as origin and z across their plane.

    Returns the coefficients (6,) of x², y², xy, x, y and 1, and the direction (3,) of z.
    """
    count = len(rows)
    mean, moments = np.zeros(3), np.zeros((3, 3))
    for row in rows:
        mean += points[row] / count
    for row in rows:
        offset = points[row] - mean
        for j in range(3):
            moments[j] += offset[j] * offset
    _, axes = np.linalg.eigh(moments)
    terms, heights = np.empty((count, 6)), np.empty(count)
    for i in range(count):
        offset = points[rows[i]] - origin
        x, y = np.sum(offset * axes[:, 2]), np.sum(offset * axes[:, 1])
        terms[i, 0], terms[i, 1], terms[i, 2] = x * x, y * y, x * y
        terms[i, 3], terms[i, 4], terms[i, 5] = x, y, 1.0
        heights[i] = np.sum(offset * axes[:, 0])
    return _least_squares(terms, heights), axes[:, 0].copy()


@compiled
def _least_squares(a: Floats, b: Floats) -> Floats:
    """Solve a x = b by QR with column pivoting, in place; unknowns that are left open are 0."""
    height, width = a.shape
    order, rank, largest = np.arange(width), 0, 0.0
    for k in range(min(height, width)):
        squared, place = -1.0, k
        for j in range(k, width):
            norm = np.sum(a[k:, j] ** 2)
            if norm > squared:
                squared, place = norm, j
        largest = max(largest, squared)
        if squared <= largest * _SMALLEST**2 * (height - k) / height:
            break
        order[k], order[place] = order[place], order[k]
        for i in range(height):
            a[i, k], a[i, place] = a[i, place], a[i, k]
        diagonal = -np.sqrt(squared) if a[k, k] > 0 else np.sqrt(squared)
        a[k, k] -= diagonal  # the column is now the axis of a reflection
        scale = 2 / np.sum(a[k:, k] ** 2)
        for j in range(k + 1, width):
            a[k:, j] -= scale * np.sum(a[k:, k] * a[k:, j]) * a[k:, k]
        b[k:] -= scale * np.sum(a[k:, k] * b[k:]) * a[k:, k]
        a[k, k] = diagonal
        rank += 1
    solution = np.zeros(width)
    for k in range(rank - 1, -1, -1):
        known = 0.0
        for j in range(k + 1, rank):
            known += a[k, j] * solution[order[j]]
        solution[order[k]] = (b[k] - known) / a[k, k]
    return solution


@compiled
def _features(
    first: int,
    starts: Rows,
    rows: Rows,
    points: Floats,
    projected: Floats,
    curvature: Floats,
    other_curvature: Floats,
    light: Floats,
    other_light: Floats,
    sigma: float,
) -> Floats:
    """Return sums (3,) of the features of the points from `first` on that have the neighbours.

    The features are the difference in the structure of the curvatures (from 0), and the likeness of
    the lightness and of its structure (up to 1).
    """
    sums = np.zeros(3)
    for i in range(len(starts) - 1):
        near = rows[starts[i] : starts[i + 1]]
        here = first + i
        weights, other_weights = np.empty(len(near)), np.empty(len(near))
        for j in range(len(near)):
            squared = np.sum((points[near[j]] - points[here]) ** 2)
            other_squared = np.sum((projected[near[j]] - projected[here]) ** 2)
            weights[j] = np.exp(-squared / (2 * sigma**2))
            other_weights[j] = np.exp(-other_squared / (2 * sigma**2))
        weights /= np.sum(weights)
        other_weights /= np.sum(other_weights)
        bent, other_bent = curvature[near], other_curvature[near]
        bent = bent - np.sum(weights * bent)
        other_bent = other_bent - np.sum(other_weights * other_bent)
        spread = np.sqrt(np.sum(weights * bent**2) * np.sum(other_weights * other_bent**2))
        common = np.sum(weights * bent * other_bent)
        sums[0] += min(1.0, abs(spread - common) / (spread + 1.0))
        lit, other_lit = light[near], other_light[near]
        difference = np.sum(weights * lit) - np.sum(other_weights * other_lit)
        sums[1] += 1 / (0.002 * difference**2 + 1)
        lit, other_lit = lit - np.mean(lit), other_lit - np.mean(other_lit)
        spread = np.sqrt(np.mean(lit**2) * np.mean(other_lit**2))
        sums[2] += (np.mean(lit * other_lit) + 0.1) / (spread + 0.1)
    return sums

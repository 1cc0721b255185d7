from __future__ import annotations

import numpy as np

from pointkit.compiling import compiled
from pointkit.geometry.cloud import Floats, check_points
from pointkit.geometry.spatial_order import distinct_points

BLOCK = 64
"""Number of points per bounding box, fastest for points on a sphere (the worst case)."""
ROUNDING = 1e-12
"""Relative tolerance that covers rounding errors of the bounds."""


def diameter(points: Floats) -> float:
    """Return the exact largest distance between two points of a cloud (n, 3)."""
    check_points(points, "diameter")
    points = np.ascontiguousarray(points, dtype=np.float64)
    centre, length = _far_pair(points)
    radii = _distances(points, centre)
    candidates = points[radii >= length * (1 - ROUNDING) - radii.max()]
    _, candidates = distinct_points(candidates)
    least = length**2 * (1 - ROUNDING)
    return float(np.sqrt(_largest_squared(candidates, *_boxes(candidates), least)))


def _boxes(points: Floats) -> tuple[Floats, Floats]:
    """Return bounding boxes (b, 2, 3) of blocks of points, and the lengths (b,) of diagonals."""
    starts = np.arange(0, len(points), BLOCK)
    low, high = (each.reduceat(points, starts, axis=0) for each in (np.minimum, np.maximum))
    return np.stack([low, high], axis=1), np.linalg.norm(high - low, axis=1)


def _distances(points: Floats, centre: Floats) -> Floats:
    x, y, z = points[:, 0] - centre[0], points[:, 1] - centre[1], points[:, 2] - centre[2]
    return np.asarray(np.sqrt(x * x + y * y + z * z))


def _far_pair(points: Floats) -> tuple[Floats, float]:
    """Return the centre (3,) and the length of the segment between two distant points."""
    point, centre, length = points[0], points[0], -1.0
    while True:
        distances = _distances(points, point)
        farthest = int(np.argmax(distances))
        if distances[farthest] <= length:
            return centre, length
        centre, length = (point + points[farthest]) / 2, float(distances[farthest])
        point = points[farthest]


@compiled
def _largest_squared(points: Floats, boxes: Floats, diagonals: Floats, largest: float) -> float:
    for i in range(len(boxes)):
        for j in range(i + 1):
            across = (diagonals[i] + diagonals[j]) / 2
            if (
                _box_squared(boxes, i, j) > largest
                and _cap_squared(points, boxes, across, i, j) > largest
            ):
                largest = max(largest, _pairs_squared(points, i, j))
    return largest


@compiled
def _box_squared(boxes: Floats, i: int, j: int) -> float:
    x = max(boxes[i, 1, 0] - boxes[j, 0, 0], boxes[j, 1, 0] - boxes[i, 0, 0])
    y = max(boxes[i, 1, 1] - boxes[j, 0, 1], boxes[j, 1, 1] - boxes[i, 0, 1])
    z = max(boxes[i, 1, 2] - boxes[j, 0, 2], boxes[j, 1, 2] - boxes[i, 0, 2])
    return float(x * x + y * y + z * z)


@compiled
def _cap_squared(points: Floats, boxes: Floats, across: float, i: int, j: int) -> float:
    """Return an upper bound of the squared distance between a point of box i and a point of box j.

    The bound uses the points' extents along the line between the boxes' centres.
    """
    x = boxes[i, 0, 0] + boxes[i, 1, 0] - boxes[j, 0, 0] - boxes[j, 1, 0]
    y = boxes[i, 0, 1] + boxes[i, 1, 1] - boxes[j, 0, 1] - boxes[j, 1, 1]
    z = boxes[i, 0, 2] + boxes[i, 1, 2] - boxes[j, 0, 2] - boxes[j, 1, 2]
    length = np.sqrt(x * x + y * y + z * z)
    if length == 0:
        return np.inf
    x, y, z = x / length, y / length, z / length
    top, bottom = -np.inf, np.inf
    for k in range(i * BLOCK, min(len(points), (i + 1) * BLOCK)):
        top = max(top, points[k, 0] * x + points[k, 1] * y + points[k, 2] * z)
    for k in range(j * BLOCK, min(len(points), (j + 1) * BLOCK)):
        bottom = min(bottom, points[k, 0] * x + points[k, 1] * y + points[k, 2] * z)
    return ((top - bottom) ** 2 + across**2) * (1 + ROUNDING)


@compiled
def _pairs_squared(points: Floats, i: int, j: int) -> float:
    largest = 0.0
    for k in range(i * BLOCK, min(len(points), (i + 1) * BLOCK)):
        for other in range(j * BLOCK, min(len(points), (j + 1) * BLOCK)):
            x = points[k, 0] - points[other, 0]
            y = points[k, 1] - points[other, 1]
            z = points[k, 2] - points[other, 2]
            largest = max(largest, x * x + y * y + z * z)
    return largest

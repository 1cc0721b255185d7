from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats

Point = tuple[float, float]
_TOUCH = 0.005


@dataclass
class FloorPlan:
    """Floor of a room, and the space that objects occupy, in metres.

    `outline` (n, 2) has the floor's corners, counter-clockwise. An occupied space is a rectangle in
    x and y, (4, 2), and a range of z.
    """

    outline: Floats
    rectangles: list[Floats] = field(default_factory=list)
    heights: list[tuple[float, float]] = field(default_factory=list)

    def occupy(self, rectangle: Floats, low: float, high: float) -> None:
        self.rectangles.append(rectangle)
        self.heights.append((low, high))

    def is_free(self, rectangle: Floats, low: float, high: float) -> bool:
        """Return whether a rectangle is on the floor, with free space from `low` to `high`."""
        if not self.contains(rectangle):
            return False
        if not self.rectangles:
            return True
        spans = np.array(self.heights)
        level = (spans[:, 0] < high - _TOUCH) & (spans[:, 1] > low + _TOUCH)
        if not level.any():
            return True
        others = np.stack(self.rectangles)[level]
        return not bool(_overlaps(rectangle, others).any())

    def contains(self, rectangle: Floats) -> bool:
        """Return whether a rectangle is on the floor, where it may touch the walls."""
        rectangle = rectangle + (rectangle.mean(axis=0) - rectangle) * _TOUCH
        between = (rectangle + np.roll(rectangle, -1, axis=0)) / 2
        if not _inside(np.concatenate([rectangle, between]), self.outline).all():
            return False
        return not bool(_inside(self.outline, rectangle).any())


def footprint(
    low: Sequence[float] | Floats, high: Sequence[float] | Floats, pose: Floats
) -> Floats:
    """Return the corners (4, 2) of a box's footprint at a pose (4, 4)."""
    x0, y0, x1, y1 = low[0], low[1], high[0], high[1]
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return np.asarray(corners @ pose[:2, :2].T + pose[:2, 3])


def square(x: float, y: float, half: float) -> Floats:
    return np.array(
        [(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)]
    )


def _inside(points: Floats, polygon: Floats) -> NDArray[np.bool_]:
    a, b = polygon, np.roll(polygon, -1, axis=0)
    y = points[:, 1:2]
    spans = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
    crossing = a[:, 0] + (y - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
    return np.asarray(np.count_nonzero(spans & (points[:, :1] < crossing), axis=1) % 2 == 1)


def _overlaps(rectangle: Floats, others: Floats) -> NDArray[np.bool_]:
    """Return the mask (k,) of rectangles `others` (k, 4, 2) that overlap `rectangle`."""
    rectangle_axes = np.broadcast_to(
        np.stack([rectangle[1] - rectangle[0], rectangle[3] - rectangle[0]]), (len(others), 2, 2)
    )
    other_axes = np.stack([others[:, 1] - others[:, 0], others[:, 3] - others[:, 0]], axis=1)
    axes = np.concatenate([rectangle_axes, other_axes], axis=1)
    axes = axes / np.maximum(np.linalg.norm(axes, axis=-1, keepdims=True), 1e-12)
    projections = np.einsum("kaj,cj->kac", axes, rectangle)
    other_projections = np.einsum("kaj,kcj->kac", axes, others)
    apart = (projections.max(axis=2) <= other_projections.min(axis=2) + _TOUCH) | (
        other_projections.max(axis=2) <= projections.min(axis=2) + _TOUCH
    )
    return np.asarray(~apart.any(axis=1))

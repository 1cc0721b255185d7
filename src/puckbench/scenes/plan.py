"""The floor plan of a room: occupied space, and whether a further item fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats

Point = tuple[float, float]
_TOUCH = 0.005


@dataclass
class Plan:
    """Occupied space of a room: rectangles on the plan, each from one height to another.

    Parameters
    ----------
    outline
        (n, 2) corners of the floor, counter-clockwise.
    rectangles
        (4, 2) corners each.
    heights
        Lowest and highest z of the space over each rectangle.
    """

    outline: Floats
    rectangles: list[Floats] = field(default_factory=list)
    heights: list[tuple[float, float]] = field(default_factory=list)

    def take(self, rectangle: Floats, low: float, high: float) -> None:
        """Take the space over a rectangle between two heights."""
        self.rectangles.append(rectangle)
        self.heights.append((low, high))

    def fits(self, rectangle: Floats, low: float, high: float) -> bool:
        """Whether the space over a rectangle lies in the room and is free between two heights."""
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
        """Whether a rectangle lies within the floor; it may touch the walls."""
        rectangle = rectangle + (rectangle.mean(axis=0) - rectangle) * _TOUCH
        between = (rectangle + np.roll(rectangle, -1, axis=0)) / 2
        if not _inside(np.concatenate([rectangle, between]), self.outline).all():
            return False
        return not bool(_inside(self.outline, rectangle).any())


def rectangle(
    low: Sequence[float] | Floats, high: Sequence[float] | Floats, pose: Floats
) -> Floats:
    """Corners (4, 2) of an upright box's footprint under a pose (4, 4)."""
    x0, y0, x1, y1 = low[0], low[1], high[0], high[1]
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return np.asarray(corners @ pose[:2, :2].T + pose[:2, 3])


def square(x: float, y: float, half: float) -> Floats:
    """Corners (4, 2) of a square around a point."""
    return np.array(
        [(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)]
    )


def _inside(points: Floats, polygon: Floats) -> NDArray[np.bool_]:
    """Points (n, 2) inside a polygon (m, 2), by counting crossings, (n,)."""
    a, b = polygon, np.roll(polygon, -1, axis=0)
    y = points[:, 1:2]
    spans = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
    crossing = a[:, 0] + (y - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
    return np.asarray(np.count_nonzero(spans & (points[:, :1] < crossing), axis=1) % 2 == 1)


def _overlaps(one: Floats, others: Floats) -> NDArray[np.bool_]:
    """Rectangles (k, 4, 2) that overlap one (4, 2), by separating axes, (k,)."""
    own = np.broadcast_to(np.stack([one[1] - one[0], one[3] - one[0]]), (len(others), 2, 2))
    theirs = np.stack([others[:, 1] - others[:, 0], others[:, 3] - others[:, 0]], axis=1)
    axes = np.concatenate([own, theirs], axis=1)
    axes = axes / np.maximum(np.linalg.norm(axes, axis=-1, keepdims=True), 1e-12)
    mine = np.einsum("kaj,cj->kac", axes, one)
    yours = np.einsum("kaj,kcj->kac", axes, others)
    apart = (mine.max(axis=2) <= yours.min(axis=2) + _TOUCH) | (
        yours.max(axis=2) <= mine.min(axis=2) + _TOUCH
    )
    return np.asarray(~apart.any(axis=1))

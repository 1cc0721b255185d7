from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats
from virtual_lidar.scenes.bodies import Body, Item, item_bounds, moved, posed
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.shell import Opening, depth, shell, wall_frame
from virtual_lidar.scenes.surfaces import pose

Maker = Callable[[Modeller], Item]
_TOUCH = 0.005
_MAX_TRIES = 60
SENSOR_FREE, SENSOR_TOP = 0.45, 2.0
"""Half the side, and the height, of the space that stays free for a sensor, m."""


@dataclass
class FloorPlan:
    """The floor of a room or street with the spaces that objects already occupy, in metres.

    A space is a rectangle in x and y, given by its corners (4, 2), between two heights.

    Parameters
    ----------
    outline
        Corners of the floor, counter-clockwise, (n, 2).
    rectangles, heights
        The occupied spaces: corners, and the pair of lowest and highest z.
    """

    outline: Floats
    rectangles: list[Floats] = field(default_factory=list)
    heights: list[tuple[float, float]] = field(default_factory=list)

    def occupy(self, rectangle: Floats, low: float, high: float) -> None:
        """Mark the space over a rectangle (4, 2), from height `low` to `high`, as occupied."""
        self.rectangles.append(rectangle)
        self.heights.append((low, high))

    def is_free(self, rectangle: Floats, low: float, high: float) -> bool:
        """Return whether a space lies over the floor and overlaps no occupied space."""
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
        """Return whether a rectangle (4, 2) lies on the floor; it may touch the walls."""
        rectangle = rectangle + (rectangle.mean(axis=0) - rectangle) * _TOUCH
        between = (rectangle + np.roll(rectangle, -1, axis=0)) / 2
        if not _inside(np.concatenate([rectangle, between]), self.outline).all():
            return False
        return not bool(_inside(self.outline, rectangle).any())


def footprint(
    low: Sequence[float] | Floats, high: Sequence[float] | Floats, pose: Floats
) -> Floats:
    """Return the corners (4, 2) of the base of a box after a transform.

    Parameters
    ----------
    low, high
        Lowest and highest corner of the box.
    pose
        The transform, (4, 4).
    """
    x0, y0, x1, y1 = low[0], low[1], high[0], high[1]
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return np.asarray(corners @ pose[:2, :2].T + pose[:2, 3])


def square(x: float, y: float, half: float) -> Floats:
    """Return the corners (4, 2) of a square with the centre (x, y) and sides of length 2 `half`."""
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


@dataclass(frozen=True)
class Placement:
    """A request to place an item in a room.

    Parameters
    ----------
    maker
        Function that makes the item.
    where
        "wall": on the floor, with the back to a wall. "mounted": on a wall. "floor": anywhere on
        the floor. "ceiling": hanging from the ceiling. "fixed": at the position `at`, without a
        check for collisions.
    at
        Position (x, y) or (x, y, z) in metres. For "wall" and "mounted", it is the index of the
        wall and the share (0 to 1) of the wall's length. By default, the position is random.
    turn, turn_range
        Rotation about z, and greatest random deviation from it, degrees. They count only if `at` is
        set.
    """

    maker: Maker
    where: Literal["wall", "mounted", "floor", "ceiling", "fixed"] = "wall"
    at: tuple[float, ...] | None = None
    turn: float = 0.0
    turn_range: float = 2.0


@dataclass
class Room:
    """A room during its furnishing, to which items are added one after the other.

    Parameters
    ----------
    cad
        Modeller that makes the walls and the items of the room.
    outline
        Corners of the floor, counter-clockwise, (n, 2), m.
    height
        Height of the ceiling, m.
    openings
        Doors and windows; the floor before them stays free.
    origin
        Position (x, y) of a sensor, m; the space around it stays free.

    Attributes
    ----------
    item
        All bodies of the room: the walls, floor and ceiling, and the items so far.
    """

    cad: Modeller
    outline: Floats
    height: float
    openings: tuple[Opening, ...]
    origin: tuple[float, float]
    item: Item = field(default_factory=list)
    plan: FloorPlan = field(init=False)

    def __post_init__(self) -> None:
        self.plan = FloorPlan(self.outline)
        self.plan.occupy(square(*self.origin, SENSOR_FREE), 0.0, SENSOR_TOP)
        for opening in self.openings:
            self._keep_clear(opening)
        self.item += shell(self.cad, self.outline, self.height, self.openings)

    def _keep_clear(self, opening: Opening) -> None:
        frame, length = wall_frame(self.outline, opening.wall)
        x0, x1 = opening.span(length)
        reach = 0.12 if opening.kind == "window" else 0.85
        taken = footprint((x0 - 0.1, -reach), (x1 + 0.1, depth(opening)), frame)
        self.plan.occupy(taken, opening.sill - 0.04, opening.sill + opening.height + 0.1)

    def put(self, placement: Placement) -> None:
        """Place an item, or leave it out if there is no space for it."""
        item, at = placement.maker(self.cad), placement.at
        if placement.where == "fixed":
            x, y, z = at or (0.0, 0.0, 0.0)
            self.item += moved(item, x, y, z, turn=placement.turn)
        elif placement.where == "ceiling":
            x, y = at or self.origin
            self._try(item, pose(x, y, self.height, turn=placement.turn))
        elif placement.where == "floor":
            self._on_floor(item, placement)
        else:
            self._along_wall(item, placement)

    def _try(self, item: Item, place: Floats) -> bool:
        high = item_bounds(item)[1, 2] + place[2, 3]
        if high > self.height + 1e-6 or not occupy_if_free(self.plan, item, place):
            return False
        self.item += posed(item, place)
        return True

    def _along_wall(self, item: Item, placement: Placement) -> None:
        is_mounted = placement.where == "mounted"
        gap, turn_range = ((0.0, 0.0), 0.0) if is_mounted else ((0.03, 0.08), 1.5)
        box = item_bounds(item)
        half = float(max(-box[0, 0], box[1, 0]))
        for _ in range(_MAX_TRIES):
            wall = int(self.cad.rng.integers(len(self.outline)))
            share = self.cad.between(0, 1)
            if placement.at is not None:
                wall, share = int(placement.at[0]), placement.at[1]
            frame, length = wall_frame(self.outline, wall)
            x = float(np.clip(share * length, half + 0.01, max(length - half - 0.01, half + 0.01)))
            back = float(box[1, 1]) + self.cad.between(*gap)
            turn = self.cad.between(-turn_range, turn_range)
            if self._try(item, frame @ pose(x, -back, 0, turn=turn)) or placement.at is not None:
                return

    def _on_floor(self, item: Item, placement: Placement) -> None:
        if placement.at is not None:
            turn = placement.turn + self.cad.between(-placement.turn_range, placement.turn_range)
            x, y, z = (*placement.at, 0.0)[:3]
            self._try(item, pose(x, y, z, turn=turn))
            return
        low, high = self.outline.min(axis=0), self.outline.max(axis=0)
        for _ in range(_MAX_TRIES):
            x, y = self.cad.rng.uniform(low, high)
            if self._try(item, pose(x, y, 0, turn=self.cad.between(0, 360))):
                return


def occupy_if_free(plan: FloorPlan, item: Item, place: Floats) -> bool:
    """Occupy the space of an item if it is free, and return whether it was free.

    Parameters
    ----------
    plan
        The floor, on which the space is marked as occupied.
    item
        The item.
    place
        Pose of the item, (4, 4).
    """
    low, high = item_bounds(item)[:, 2] + place[2, 3]
    grounds = [_ground(body, place) for body in _feet(item)]
    if not all(plan.is_free(ground, low, high) for ground in grounds):
        return False
    for ground in grounds:
        plan.occupy(ground, low, high)
    return True


def _ground(body: Body, place: Floats) -> Floats:
    low, high = body.surface.bounds()
    return footprint(low, high, place @ body.pose)


def _feet(item: Item) -> Item:
    lows = [item_bounds([body])[0, 2] for body in item]
    return [body for body, low in zip(item, lows, strict=True) if low < min(lows) + 0.06]


def lamp_grid(outline: Floats, maker: Maker, spacing: float) -> list[Placement]:
    """Return requests for lamps on a ceiling, in rows and columns about `spacing` metres apart."""
    low, size = outline.min(axis=0), np.ptp(outline, axis=0)
    counts = np.maximum(1, np.round(size / spacing)).astype(int)
    xs, ys = (low[k] + size[k] * (np.arange(counts[k]) + 0.5) / counts[k] for k in (0, 1))
    turn = 90.0 if size[1] > size[0] else 0.0
    return [Placement(maker, "ceiling", at=(float(x), float(y)), turn=turn) for x in xs for y in ys]

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from pointkit.geometry.cloud import Floats
from virtual_lidar.scenes.floor_plan import FloorPlan, footprint, square
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.pieces import Item, Piece, item_bounds, moved, posed
from virtual_lidar.scenes.shell import Opening, depth, shell, wall_frame
from virtual_lidar.scenes.surfaces import pose

Maker = Callable[[Modeller], Item]
MAX_TRIES = 60
SENSOR_FREE, SENSOR_TOP = 0.45, 2.0


@dataclass(frozen=True)
class Placement:
    """An item to place in a room: the function that makes the item, and the place.

    Parameters
    ----------
    where
        "wall": on the floor, back to a wall. "mounted": on a wall. "floor": anywhere on the floor.
        "ceiling": hanging. "fixed": at `at`, without a check of collisions.
    at
        Position in metres, (x, y) or (x, y, z); at walls (wall index, share of the wall's length);
        by default random.
    turn, turn_range
        Rotation about z and its random deviation, in degrees, if `at` is set.
    """

    maker: Maker
    where: Literal["wall", "mounted", "floor", "ceiling", "fixed"] = "wall"
    at: tuple[float, ...] | None = None
    turn: float = 0.0
    turn_range: float = 2.0


@dataclass
class Room:
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
        for _ in range(MAX_TRIES):
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
        for _ in range(MAX_TRIES):
            x, y = self.cad.rng.uniform(low, high)
            if self._try(item, pose(x, y, 0, turn=self.cad.between(0, 360))):
                return


def occupy_if_free(plan: FloorPlan, item: Item, place: Floats) -> bool:
    """Occupy an item's space at the pose `place` (4, 4) if free; return whether it was free."""
    low, high = item_bounds(item)[:, 2] + place[2, 3]
    grounds = [_ground(piece, place) for piece in _feet(item)]
    if not all(plan.is_free(ground, low, high) for ground in grounds):
        return False
    for ground in grounds:
        plan.occupy(ground, low, high)
    return True


def _ground(piece: Piece, place: Floats) -> Floats:
    low, high = piece.surface.bounds()
    return footprint(low, high, place @ piece.pose)


def _feet(item: Item) -> Item:
    lows = [item_bounds([piece])[0, 2] for piece in item]
    return [piece for piece, low in zip(item, lows, strict=True) if low < min(lows) + 0.06]


def lamp_grid(outline: Floats, maker: Maker, spacing: float) -> list[Placement]:
    low, size = outline.min(axis=0), np.ptp(outline, axis=0)
    counts = np.maximum(1, np.round(size / spacing)).astype(int)
    xs, ys = (low[k] + size[k] * (np.arange(counts[k]) + 0.5) / counts[k] for k in (0, 1))
    turn = 90.0 if size[1] > size[0] else 0.0
    return [Placement(maker, "ceiling", at=(float(x), float(y)), turn=turn) for x in xs for y in ys]

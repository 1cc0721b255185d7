"""Placing furniture without collisions: along walls, at given places, under the ceiling."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.scenes.builder import Furniture, Item, Piece, bounds, moved, refurnished
from puckbench.scenes.modeller import Modeller
from puckbench.scenes.plan import Plan, rectangle, square
from puckbench.scenes.shell import Opening, depth, shell, wall_frame
from puckbench.scenes.surfaces import pose

Maker = Callable[[Modeller], Item]
TRIES = 60
SENSOR_FREE, SENSOR_TOP = 0.45, 2.0


@dataclass(frozen=True)
class Placement:
    """What to place in a room, where, and how often.

    Parameters
    ----------
    maker
        Makes the item.
    where
        "wall": on the floor, back to a wall. "mounted": on a wall at the item's own height.
        "floor": anywhere on the floor. "ceiling": hanging. "fixed": at `at`, unchecked, and taking
        no space (beams, pipes, tiers).
    count
        Number of items.
    at
        (x, y) or (x, y, z) in place of a random one; for walls (number of the wall, share of its
        length).
    turn, sway
        Rotation about z and its random range to both sides, degrees, where `at` is given.
    """

    maker: Maker
    where: Literal["wall", "mounted", "floor", "ceiling", "fixed"] = "wall"
    count: int = 1
    at: tuple[float, ...] | None = None
    turn: float = 0.0
    sway: float = 2.0


@dataclass
class Room:
    """A room being furnished."""

    cad: Modeller
    outline: Floats
    height: float
    openings: tuple[Opening, ...]
    origin: tuple[float, float]
    furniture: Furniture = field(default_factory=dict)
    item: Item = field(default_factory=list)
    plan: Plan = field(init=False)

    def __post_init__(self) -> None:
        self.plan = Plan(self.outline)
        self.plan.take(square(*self.origin, SENSOR_FREE), 0.0, SENSOR_TOP)
        for opening in self.openings:
            self._keep_clear(opening)
        self.item += shell(self.cad, self.outline, self.height, self.openings)

    def _keep_clear(self, opening: Opening) -> None:
        """Space in front of a door for its leaf and people, in front of a window for its light."""
        frame, length = wall_frame(self.outline, opening.wall)
        x0, x1 = opening.span(length)
        reach = 0.12 if opening.kind == "window" else 0.85
        taken = rectangle((x0 - 0.1, -reach), (x1 + 0.1, depth(opening)), frame)
        self.plan.take(taken, opening.sill - 0.04, opening.sill + opening.height + 0.1)

    def put(self, placement: Placement) -> None:
        """Place the items, as many as fit."""
        placers = {
            "wall": self._by_wall,
            "mounted": self._mounted,
            "floor": self._on_floor,
            "ceiling": self._hanging,
            "fixed": self._fixed,
        }
        for _ in range(placement.count):
            placers[placement.where](placement)

    def _try(self, item: Item, place: Floats) -> bool:
        """Add the item at a pose if its space is free."""
        high = bounds(item)[1, 2] + place[2, 3]
        if high > self.height + 1e-6 or not claim(self.plan, item, place):
            return False
        self._add(item, place)
        return True

    def _add(self, item: Item, place: Floats) -> None:
        self.item += moved(refurnished(item, self.furniture, self.cad.rng), place)

    def _along_wall(self, placement: Placement, *, gap: tuple[float, float], sway: float) -> None:
        item = placement.maker(self.cad)
        box = bounds(item)
        half = float(max(-box[0, 0], box[1, 0]))
        for _ in range(TRIES):
            wall = int(self.cad.rng.integers(len(self.outline)))
            share = self.cad.between(0, 1)
            if placement.at is not None:
                wall, share = int(placement.at[0]), placement.at[1]
            frame, length = wall_frame(self.outline, wall)
            x = float(np.clip(share * length, half + 0.01, max(length - half - 0.01, half + 0.01)))
            back = float(box[1, 1]) + self.cad.between(*gap)
            turn = self.cad.between(-sway, sway)
            if self._try(item, frame @ pose(x, -back, 0, turn=turn)) or placement.at is not None:
                return

    def _by_wall(self, placement: Placement) -> None:
        self._along_wall(placement, gap=(0.03, 0.08), sway=1.5)

    def _mounted(self, placement: Placement) -> None:
        self._along_wall(placement, gap=(0.0, 0.0), sway=0.0)

    def _on_floor(self, placement: Placement) -> None:
        item = placement.maker(self.cad)
        if placement.at is not None:
            turn = placement.turn + self.cad.between(-placement.sway, placement.sway)
            z = placement.at[2] if len(placement.at) > 2 else 0.0
            self._try(item, pose(placement.at[0], placement.at[1], z, turn=turn))
            return
        low, high = self.outline.min(axis=0), self.outline.max(axis=0)
        for _ in range(TRIES):
            x, y = self.cad.rng.uniform(low, high)
            if self._try(item, pose(x, y, 0, turn=self.cad.between(0, 360))):
                return

    def _hanging(self, placement: Placement) -> None:
        x, y = placement.at or self.origin
        self._try(placement.maker(self.cad), pose(x, y, self.height, turn=placement.turn))

    def _fixed(self, placement: Placement) -> None:
        x, y, z = placement.at or (0.0, 0.0, 0.0)
        self._add(placement.maker(self.cad), pose(x, y, z, turn=placement.turn))


def claim(plan: Plan, item: Item, place: Floats) -> bool:
    """Take the space of an item that stands at a pose (4, 4); whether all of it was free."""
    low, high = bounds(item)[:, 2] + place[2, 3]
    grounds = [_ground(piece, place) for piece in _feet(item)]
    if not all(plan.fits(one, low, high) for one in grounds):
        return False
    for ground in grounds:
        plan.take(ground, low, high)
    return True


def _ground(piece: Piece, place: Floats) -> Floats:
    """The piece's rectangle (4, 2) on the plan when its item is at a pose."""
    low, high = piece.surface.bounds()
    return rectangle(low, high, place @ piece.pose)


def _feet(item: Item) -> Item:
    """The pieces of an item that reach down to its lowest level: those it stands on."""
    lows = [bounds([piece])[0, 2] for piece in item]
    return [piece for piece, low in zip(item, lows, strict=True) if low < min(lows) + 0.06]


def lamp_grid(
    maker: Maker, outline: Floats, spacing: float, turn: float = 0.0
) -> Sequence[Placement]:
    """Lamps in rows over a room's whole bounding box; those outside the room will not fit."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    counts = np.maximum(1, np.round((high - low) / spacing)).astype(int)
    xs, ys = (
        low[k] + (high[k] - low[k]) * (np.arange(counts[k]) + 0.5) / counts[k] for k in (0, 1)
    )
    return [Placement(maker, "ceiling", at=(float(x), float(y)), turn=turn) for x in xs for y in ys]

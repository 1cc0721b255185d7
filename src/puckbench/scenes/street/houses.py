"""Houses of a street: walls pierced by windows and doors that lie deeper, roofs and what hangs on.

A house stands on z = 0, its front at y = 0 towards -y, centred in x.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.scenes import outlines
from puckbench.scenes.builder import Item, Piece
from puckbench.scenes.modeller import Modeller
from puckbench.scenes.shell import door_leaf
from puckbench.scenes.solids import box, extrude
from puckbench.scenes.surfaces import Surface, join, planar

LEAST_WIDTH, MOST_WIDTH = 7.0, 17.0
BALCONY = 1.1
"""How far a balcony stands out, m."""
_SILL, _FRAME = 0.06, 0.05


@dataclass(frozen=True)
class _Hole:
    """A rectangular hole of a front: its middle x, lower edge z and sizes, m."""

    x: float
    z: float
    width: float
    height: float

    @property
    def sides(self) -> tuple[float, float]:
        """Its two sides."""
        return self.x - self.width / 2, self.x + self.width / 2


@dataclass(frozen=True)
class _Front:
    """How a house looks from the street, m.

    Parameters
    ----------
    width, height
        Of the front, up to the eaves.
    lower, upper, shops
        Holes of windows at the ground, above it by storey, and of shop windows.
    door
        The hole of the door.
    reveal
        How deep windows lie behind the front.
    """

    width: float
    height: float
    lower: list[_Hole]
    upper: list[list[_Hole]]
    shops: list[_Hole]
    door: _Hole
    reveal: float

    @property
    def windows(self) -> list[_Hole]:
        """The holes of all windows."""
        return [*self.lower, *(one for storey in self.upper for one in storey), *self.shops]


def house(cad: Modeller, width: float, depth: float) -> Item:
    """A house of one to four storeys with one kind of windows, a door, and shops in some."""
    front = _planned(cad, width)
    holes = [*front.windows, front.door]
    walls = [_walls(cad, front, depth), _pierced(width, front.height, holes)]
    panes: list[Surface] = []
    for hole in front.windows:
        reveal, window = _window(hole, front.reveal)
        walls.append(reveal)
        panes.append(window)
    reveal, leaf = _door(cad, front.door)
    walls += [reveal, *_hangings(cad, front)]
    pieces = [Piece("house", "building", join(walls)), Piece("door", "door", leaf)]
    return [*pieces, Piece("windows", "window", join(panes))]


def _planned(cad: Modeller, width: float) -> _Front:
    storeys = int(cad.rng.integers(1, 5))
    rise = cad.between(2.75, 3.4)
    ground = rise + cad.between(0.2, 0.8)
    columns = max(2, round((width - 0.6) / cad.between(1.9, 2.9)))
    pitch = width / columns
    wide, tall = min(pitch * cad.between(0.45, 0.62), 1.7), cad.between(1.3, 1.8)
    middles = (np.arange(columns) + 0.5) * pitch - width / 2
    entrance = int(cad.rng.integers(columns))
    beside = np.delete(middles, entrance)
    shop = cad.chance(0.35)
    levels = [ground + rise * k for k in range(storeys - 1)]
    upper = [[_Hole(float(x), z + 0.85, wide, tall) for x in middles] for z in levels]
    lower = [_Hole(float(x), 1.15, wide, tall) for x in beside]
    shops = [_Hole(float(x), 0.5, pitch * 0.86, ground - 1.1) for x in beside]
    return _Front(
        width,
        ground + rise * (storeys - 1) + 0.4,
        [] if shop else lower,
        upper,
        shops if shop else [],
        _Hole(float(middles[entrance]), 0.02, min(1.15, pitch * 0.7), 2.25),
        cad.between(0.12, 0.32),
    )


def _pierced(width: float, height: float, holes: Sequence[_Hole]) -> Surface:
    """A plane at y = 0 with holes, from z = 0 up, its front to -y: the cells of a grid."""
    xs = np.unique([-width / 2, width / 2, *(x for one in holes for x in one.sides)])
    zs = np.unique([0.0, height, *(z for one in holes for z in (one.z, one.z + one.height))])
    middle_x, middle_z = (xs[1:] + xs[:-1]) / 2, (zs[1:] + zs[:-1]) / 2
    kept = np.ones((len(middle_x), len(middle_z)), dtype=bool)
    for hole in holes:
        within_x = (middle_x > hole.sides[0]) & (middle_x < hole.sides[1])
        within_z = (middle_z > hole.z) & (middle_z < hole.z + hole.height)
        kept[np.ix_(within_x, within_z)] = False
    column, row = np.nonzero(kept)
    corner = column * len(zs) + row
    right, above = corner + len(zs), corner + 1
    halves = [(corner, right, right + 1), (corner, right + 1, above)]
    triangles = np.concatenate([np.column_stack(half) for half in halves])
    x, z = np.meshgrid(xs, zs, indexing="ij")
    return planar(np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()]), triangles)


def _recess(hole: _Hole, depth: float) -> tuple[Surface, Surface]:
    """The four sides of a hole that is `depth` m deep, and its back."""
    whole = box(hole.width, depth, hole.height).turned_inside_out()
    whole = whole.at(hole.x, depth / 2, hole.z)
    return whole.only(0, 1, 4, 5), whole.only(3)


def _window(hole: _Hole, reveal: float) -> tuple[Surface, Surface]:
    """The sides of a window's hole; its frame around panes, and its sill."""
    sides, _ = _recess(hole, reveal)
    count = max(1, round(hole.width / 0.8))
    pane = hole.width / count
    middles = (np.arange(count) + 0.5) * pane - hole.width / 2
    size = (pane - 1.6 * _FRAME, hole.height - 2 * _FRAME)
    panes = [_Hole(float(x), _FRAME, *size) for x in middles]
    frame = [_pierced(hole.width, hole.height, panes)]
    frame += [part for one in panes for part in _recess(one, 0.04)]
    sill = box(hole.width + 0.1, _SILL, 0.04).at(hole.x, -_SILL / 2, hole.z - 0.04)
    return sides, join([join(frame).at(hole.x, reveal, hole.z), sill])


def _door(cad: Modeller, hole: _Hole) -> tuple[Surface, Surface]:
    """The sides of a door's hole; its leaf, its back and the step before it."""
    depth = 0.4
    sides, back = _recess(hole, depth)
    leaf = door_leaf(cad, hole.width - 0.02, hole.height - 0.02).at(hole.x, depth - 0.06, hole.z)
    step = box(hole.width + 0.3, 0.35, 0.14).at(hole.x, -0.175)
    return sides, join([leaf, back, step])


def _walls(cad: Modeller, front: _Front, depth: float) -> Surface:
    """The walls but the pierced one, and a roof: flat, or its ridge along or across the street."""
    x, z, rise = front.width / 2, front.height, cad.between(0.25, 0.42)
    roof = cad.pick(("flat", "along", "along", "across"))
    if roof == "across" and front.width < 12:
        side = outlines.polygon((-x, 0), (x, 0), (x, z), (0, z + 2 * rise * x), (-x, z))
        body = extrude(side, depth).at(tilt=90).at(y=depth).only(1, 3, 4, 5, 6)
        return join([body, _triangle((-x, z), (x, z), (0.0, z + 2 * rise * x))])
    ridge = [] if roof == "flat" else [(depth / 2, z + rise * depth)]
    side = outlines.polygon((0, 0), (depth, 0), (depth, z), *ridge, (0, z))
    kept = range(3, len(side) + 1)
    body = extrude(side, front.width).only(0, 1, *kept).at(tilt=90).at(turn=90).at(x=-x)
    return join([body, _on_top(cad, front, depth, rise if ridge else 0.0)])


def _triangle(*corners: tuple[float, float]) -> Surface:
    """A triangle at y = 0 of corners (x, z), its front to -y."""
    return planar(np.array([(x, 0.0, z) for x, z in corners]), np.array([[0, 1, 2]]))


def _on_top(cad: Modeller, front: _Front, depth: float, rise: float) -> Surface:
    """Cornice along the front, and a chimney that stands out of a roof of this rise."""
    out = cad.between(0.18, 0.4)
    cornice = box(front.width, out, 0.2).at(y=-out / 2, z=front.height - 0.2)
    chimney = box(0.7, 0.5, 0.8 * rise * depth + 1.0)
    x = cad.between(-0.4, 0.4) * front.width
    return join([cornice, chimney.at(x, depth * 0.6, front.height)])


def _hangings(cad: Modeller, front: _Front) -> list[Surface]:
    """Downpipe, balconies before some windows, and an awning over shops."""
    pipe = cad.cylinder(0.05, front.height - 0.3)
    parts = [pipe.at(front.width / 2 - 0.12, -0.07, 0.05)]
    if front.upper and cad.chance(0.35):
        column = int(cad.rng.integers(len(front.upper[0])))
        holes = [storey[column] for storey in front.upper]
        parts += [_balcony(hole.width + 0.8).at(hole.x, 0, hole.z - 0.8) for hole in holes]
    if front.shops and cad.chance(0.6):
        z = front.shops[0].z + front.shops[0].height + 0.25
        wide = max(one.width for one in front.shops)
        awning = box(wide, 1.3, 0.04).at(y=-0.65).at(tilt=14)
        parts += [awning.at(one.x, 0, z) for one in front.shops]
    return parts


def _balcony(width: float) -> Surface:
    """Slab with a railing of bars."""
    slab = box(width, BALCONY, 0.14).at(y=-BALCONY / 2, z=-0.14)
    rail = 0.05 - BALCONY
    rails = [box(width, 0.05, 0.05).at(y=rail, z=z) for z in (0.1, 1.0)]
    bars = [box(0.025, 0.025, 0.85).at(float(x), rail, 0.15) for x in _spread(width, 0.12)]
    sides = [
        box(0.04, BALCONY - 0.1, 0.04).at(s * (width / 2 - 0.02), -BALCONY / 2, 1.0)
        for s in (-1, 1)
    ]
    return join([slab, *rails, *bars, *sides])


def _spread(length: float, step: float) -> Floats:
    """Places along a length, centred, about `step` apart."""
    return np.linspace(-length / 2, length / 2, max(2, round(length / step)))

"""Models of houses on z = 0, centred in x, with the facade at y = 0 facing -y."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pointkit.geometry.cloud import Floats
from virtual_lidar.scenes.bodies import Body, Item
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outlines import polygon
from virtual_lidar.scenes.shell import door_leaf, recess
from virtual_lidar.scenes.solids import box, extrude
from virtual_lidar.scenes.surfaces import Surface, join, planar

MIN_WIDTH, MAX_WIDTH = 7.0, 17.0
BALCONY_DEPTH = 1.1
_SILL, _FRAME = 0.06, 0.05


@dataclass(frozen=True)
class _Opening:
    x: float
    z: float
    width: float
    height: float

    @property
    def sides(self) -> tuple[float, float]:
        return self.x - self.width / 2, self.x + self.width / 2


@dataclass(frozen=True)
class _Facade:
    width: float
    height: float
    lower: list[_Opening]
    upper: list[list[_Opening]]
    shops: list[_Opening]
    door: _Opening
    reveal: float

    @property
    def windows(self) -> list[_Opening]:
        return [*self.lower, *(opening for storey in self.upper for opening in storey), *self.shops]


def house(cad: Modeller, width: float, depth: float) -> Item:
    """Make a house of one to four storeys, with shops or windows on the ground floor."""
    facade = _design_facade(cad, width)
    openings = [*facade.windows, facade.door]
    walls = [_walls(cad, facade, depth), _wall_with_openings(width, facade.height, openings)]
    panes: list[Surface] = []
    for opening in facade.windows:
        reveal, window = _window(opening, facade.reveal)
        walls.append(reveal)
        panes.append(window)
    reveal, leaf = _door(cad, facade.door)
    walls += [reveal, *_attachments(cad, facade)]
    bodies = [Body("house", "building", join(walls)), Body("door", "door", leaf)]
    return [*bodies, Body("windows", "window", join(panes))]


def _design_facade(cad: Modeller, width: float) -> _Facade:
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
    upper = [[_Opening(float(x), z + 0.85, wide, tall) for x in middles] for z in levels]
    lower = [_Opening(float(x), 1.15, wide, tall) for x in beside]
    shops = [_Opening(float(x), 0.5, pitch * 0.86, ground - 1.1) for x in beside]
    return _Facade(
        width,
        ground + rise * (storeys - 1) + 0.4,
        [] if shop else lower,
        upper,
        shops if shop else [],
        _Opening(float(middles[entrance]), 0.02, min(1.15, pitch * 0.7), 2.25),
        cad.between(0.12, 0.32),
    )


def _wall_with_openings(width: float, height: float, openings: Sequence[_Opening]) -> Surface:
    xs = np.unique([-width / 2, width / 2, *(x for opening in openings for x in opening.sides)])
    zs = np.unique(
        [0.0, height, *(z for opening in openings for z in (opening.z, opening.z + opening.height))]
    )
    middle_x, middle_z = (xs[1:] + xs[:-1]) / 2, (zs[1:] + zs[:-1]) / 2
    is_wall = np.ones((len(middle_x), len(middle_z)), dtype=bool)
    for opening in openings:
        within_x = (middle_x > opening.sides[0]) & (middle_x < opening.sides[1])
        within_z = (middle_z > opening.z) & (middle_z < opening.z + opening.height)
        is_wall[np.ix_(within_x, within_z)] = False
    column, row = np.nonzero(is_wall)
    corner = column * len(zs) + row
    right, above = corner + len(zs), corner + 1
    halves = [(corner, right, right + 1), (corner, right + 1, above)]
    triangles = np.concatenate([np.column_stack(half) for half in halves])
    x, z = np.meshgrid(xs, zs, indexing="ij")
    return planar(np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()]), triangles)


def _recess(opening: _Opening, depth: float) -> tuple[Surface, Surface]:
    sides, back = recess(opening.width, depth, opening.height)
    return sides.at(opening.x, 0, opening.z), back.at(opening.x, 0, opening.z)


def _window(opening: _Opening, reveal: float) -> tuple[Surface, Surface]:
    sides, _ = _recess(opening, reveal)
    count = max(1, round(opening.width / 0.8))
    pane = opening.width / count
    middles = (np.arange(count) + 0.5) * pane - opening.width / 2
    size = (pane - 1.6 * _FRAME, opening.height - 2 * _FRAME)
    panes = [_Opening(float(x), _FRAME, *size) for x in middles]
    frame = [_wall_with_openings(opening.width, opening.height, panes)]
    frame += [part for pane_opening in panes for part in _recess(pane_opening, 0.04)]
    sill = box(opening.width + 0.1, _SILL, 0.04).at(opening.x, -_SILL / 2, opening.z - 0.04)
    return sides, join([join(frame).at(opening.x, reveal, opening.z), sill])


def _door(cad: Modeller, opening: _Opening) -> tuple[Surface, Surface]:
    depth = 0.4
    sides, back = _recess(opening, depth)
    leaf = door_leaf(cad, opening.width - 0.02, opening.height - 0.02)
    step = box(opening.width + 0.3, 0.35, 0.14).at(opening.x, -0.175)
    return sides, join([leaf.at(opening.x, depth - 0.06, opening.z), back, step])


def _walls(cad: Modeller, facade: _Facade, depth: float) -> Surface:
    x, z, rise = facade.width / 2, facade.height, cad.between(0.25, 0.42)
    roof = cad.pick(("flat", "along", "along", "across"))
    if roof == "across" and facade.width < 12:
        side = polygon((-x, 0), (x, 0), (x, z), (0, z + 2 * rise * x), (-x, z))
        body = extrude(side, depth).at(tilt=90).at(y=depth).select(1, 3, 4, 5, 6)
        gable = np.array([(-x, 0.0, z), (x, 0.0, z), (0.0, 0.0, z + 2 * rise * x)])
        return join([body, planar(gable, np.array([[0, 1, 2]]))])
    ridge = [] if roof == "flat" else [(depth / 2, z + rise * depth)]
    side = polygon((0, 0), (depth, 0), (depth, z), *ridge, (0, z))
    faces = range(3, len(side) + 1)
    body = extrude(side, facade.width).select(0, 1, *faces).at(tilt=90).at(turn=90).at(x=-x)
    return join([body, _cornice_and_chimney(cad, facade, depth, rise if ridge else 0.0)])


def _cornice_and_chimney(cad: Modeller, facade: _Facade, depth: float, rise: float) -> Surface:
    out = cad.between(0.18, 0.4)
    cornice = box(facade.width, out, 0.2).at(y=-out / 2, z=facade.height - 0.2)
    chimney = box(0.7, 0.5, 0.8 * rise * depth + 1.0)
    x = cad.between(-0.4, 0.4) * facade.width
    return join([cornice, chimney.at(x, depth * 0.6, facade.height)])


def _attachments(cad: Modeller, facade: _Facade) -> list[Surface]:
    pipe = cad.cylinder(0.05, facade.height - 0.3)
    parts = [pipe.at(facade.width / 2 - 0.12, -0.07, 0.05)]
    if facade.upper and cad.chance(0.35):
        column = int(cad.rng.integers(len(facade.upper[0])))
        openings = [storey[column] for storey in facade.upper]
        parts += [
            _balcony(opening.width + 0.8).at(opening.x, 0, opening.z - 0.8) for opening in openings
        ]
    if facade.shops and cad.chance(0.6):
        z = facade.shops[0].z + facade.shops[0].height + 0.25
        wide = max(shop.width for shop in facade.shops)
        awning = box(wide, 1.3, 0.04).at(y=-0.65).at(tilt=14)
        parts += [awning.at(shop.x, 0, z) for shop in facade.shops]
    return parts


def _balcony(width: float) -> Surface:
    slab = box(width, BALCONY_DEPTH, 0.14).at(y=-BALCONY_DEPTH / 2, z=-0.14)
    rail = 0.05 - BALCONY_DEPTH
    rails = [box(width, 0.05, 0.05).at(y=rail, z=z) for z in (0.1, 1.0)]
    bars = [box(0.025, 0.025, 0.85).at(float(x), rail, 0.15) for x in _positions(width, 0.12)]
    sides = box(0.04, BALCONY_DEPTH - 0.1, 0.04).at_sides(width / 2 - 0.02, -BALCONY_DEPTH / 2, 1.0)
    return join([slab, *rails, *bars, *sides])


def _positions(length: float, step: float) -> Floats:
    return np.linspace(-length / 2, length / 2, max(2, round(length / step)))

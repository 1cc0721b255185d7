from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pointkit.geometry.cloud import Floats
from virtual_lidar.scenes.bodies import Body, Item, posed
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outlines import Point, polygon
from virtual_lidar.scenes.solids import box, flat
from virtual_lidar.scenes.surfaces import Surface, join

_DEPTHS = {"door": 0.14, "passage": 1.4, "window": 0.2}
CASING = 0.07


@dataclass(frozen=True)
class Opening:
    """A door or window in a wall, in metres.

    Parameters
    ----------
    wall
        Index of the edge of the room's outline on which the wall stands.
    at
        Centre of the opening as a share (0 to 1) of the wall's length, counted from the end of the
        edge.
    kind
        ``"door"`` is a closed door, ``"passage"`` an open door that leads to a closed space,
        ``"window"`` a window.
    width, height
        Size of the opening.
    sill
        Height of the lower edge above the floor.
    """

    wall: int
    at: float
    kind: Literal["door", "passage", "window"] = "door"
    width: float = 0.95
    height: float = 2.08
    sill: float = 0.0

    def span(self, length: float) -> tuple[float, float]:
        """Return where the opening begins and ends along a wall of the given length, m."""
        return self.at * length - self.width / 2, self.at * length + self.width / 2


def window(
    wall: int, at: float, width: float = 1.4, height: float = 1.35, sill: float = 0.9
) -> Opening:
    """Return a window with the usual size and sill."""
    return Opening(wall, at, "window", width, height, sill)


def wall_frame(outline: Floats, wall: int) -> tuple[Floats, float]:
    """Return the pose (4, 4) and the length (m) of wall number `wall` of an outline (n, 2).

    The pose's x axis lies along the wall, its y axis points out of the room, and its origin is the
    end of the wall's edge in the outline.
    """
    start, end = outline[wall], outline[(wall + 1) % len(outline)]
    length = float(np.linalg.norm(end - start))
    along = (start - end) / length
    pose = np.eye(4)
    pose[:2, 0] = along
    pose[:2, 1] = (-along[1], along[0])
    pose[:2, 3] = end
    return pose, length


def shell(cad: Modeller, outline: Floats, height: float, openings: tuple[Opening, ...]) -> Item:
    """Make the floor, ceiling and walls of a room with doors and windows, facing inwards."""
    ground = polygon(*[(float(x), float(y)) for x, y in outline])
    item = [Body("floor", "floor", flat(ground))]
    item.append(Body("ceiling", "ceiling", flat(ground).flipped().at(z=height)))
    for wall in range(len(outline)):
        pose, length = wall_frame(outline, wall)
        wall_openings = [opening for opening in openings if opening.wall == wall]
        parts = [Body("wall", "wall", _wall(length, height, wall_openings))]
        parts.append(Body("skirting", "wall", _skirting(length, wall_openings)))
        for opening in wall_openings:
            middle = np.eye(4)
            middle[0, 3], middle[2, 3] = opening.at * length, opening.sill
            parts += posed(_FILLINGS[opening.kind](cad, opening), middle)
        item += posed([part for part in parts if len(part.surface.triangles)], pose)
    return item


def depth(opening: Opening) -> float:
    """Return how deep an opening is, m."""
    return _DEPTHS[opening.kind]


def _wall(length: float, height: float, openings: list[Opening]) -> Surface:
    border: list[Point] = [(0.0, 0.0)]
    holes = []
    for opening in sorted(openings, key=lambda each: each.at):
        x0, x1 = opening.span(length)
        low, high = opening.sill, opening.sill + opening.height
        if low > 0:
            holes.append(polygon((x0, low), (x1, low), (x1, high), (x0, high)))
        else:
            border += [(x0, 0.0), (x0, high), (x1, high), (x1, 0.0)]
    border += [(length, 0.0), (length, height), (0.0, height)]
    plane = flat(polygon(*border), holes).at(tilt=90)
    sides = [_recess(each)[0].at(each.at * length, 0, each.sill) for each in openings]
    return join([plane, *sides])


def recess(width: float, depth: float, height: float) -> tuple[Surface, Surface]:
    """Make the sides and the back of an opening in a wall at y = 0.

    The opening begins at z = 0 and is centred in x. The sides and the back are returned as two
    surfaces.
    """
    whole = box(width, depth, height).flipped().at(y=depth / 2)
    return whole.select(0, 1, 4, 5), whole.select(3)


def _recess(opening: Opening) -> tuple[Surface, Surface]:
    return recess(opening.width, depth(opening), opening.height)


def _skirting(length: float, openings: list[Opening]) -> Surface:
    doors = sorted(each.span(length) for each in openings if each.sill == 0)
    starts = [0.0, *(x1 + CASING for _, x1 in doors)]
    ends = [*(x0 - CASING for x0, _ in doors), length]
    boards = [
        box(x1 - x0, 0.014, 0.085).at((x0 + x1) / 2, -0.007)
        for x0, x1 in zip(starts, ends, strict=True)
        if x1 - x0 > 0.02
    ]
    return join(boards) if boards else box(1, 1, 1).select()


def _casing(width: float, height: float) -> list[Surface]:
    sides = box(CASING, 0.02, height + CASING).at_sides((width + CASING) / 2, -0.01)
    return [*sides, box(width, 0.02, CASING).at(y=-0.01, z=height)]


def door_leaf(cad: Modeller, width: float, height: float) -> Surface:
    """Make the leaf of a door, with handle and hinges, facing -y."""
    board = box(width, 0.04, height).at(y=0.02)
    panels = [box(width * 0.68, 0.008, z).at(0, -0.004, at) for at, z in ((0.2, 0.65), (1.05, 0.8))]
    x = width / 2 - 0.07
    plate = cad.slab(0.045, 0.2, 0.008, 0.015).at(x, 0, 1.03, tilt=90)
    lever = cad.pipe([(x, 0, 1.05), (x, -0.055, 1.05), (x - 0.12, -0.055, 1.05)], 0.009, 0.02)
    hinges = [cad.cylinder(0.009, 0.09).at(-width / 2 + 0.004, -0.004, z) for z in (0.25, 1.7)]
    return join([board, *panels, plate, lever, *hinges])


def _door(cad: Modeller, opening: Opening) -> Item:
    leaf = door_leaf(cad, opening.width - 0.008, opening.height - 0.008).at(y=0.08, z=0.004)
    parts = [leaf, _recess(opening)[1], *_casing(opening.width, opening.height)]
    return [Body("door", "door", join(parts))]


def _passage(cad: Modeller, opening: Opening) -> Item:
    leaf, half = door_leaf(cad, opening.width - 0.008, opening.height - 0.008), opening.width / 2
    swung = leaf.at(x=half).at(-half + 0.06, 0.12, 0.004, turn=cad.between(84, 89))
    frame = join([swung, *_casing(opening.width, opening.height)])
    return [Body("door", "door", frame), Body("passage_end", "wall", _recess(opening)[1])]


def _window(cad: Modeller, opening: Opening) -> Item:
    width, height, y = opening.width, opening.height, depth(opening) - 0.03
    bars = box(0.06, 0.06, height).at_sides(width / 2 - 0.03, y)
    bars += [box(width - 0.12, 0.06, 0.06).at(y=y, z=z) for z in (0.0, height - 0.06)]
    count = max(1, round(width / 0.75))
    xs = (np.arange(1, count) / count - 0.5) * width
    bars += [box(0.07, 0.05, height - 0.12).at(float(x), y + 0.005, 0.06) for x in xs]
    x = float(xs[0]) if len(xs) else 0.0
    grip = cad.rod((x, y - 0.05, height * 0.4), (x, y - 0.05, height * 0.52), 0.01)
    sill = cad.slab(width + 0.1, 0.09, 0.03, 0.02).at(y=-0.045, z=-0.03)
    frame = Body("window_frame", "window", join([*bars, grip, sill]))
    return [frame, Body("window_pane", "window", _recess(opening)[1])]


_FILLINGS = {"door": _door, "passage": _passage, "window": _window}

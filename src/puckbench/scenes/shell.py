"""The shell of a room: floor, ceiling, walls with openings, doors, windows and skirting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.scenes import outlines
from puckbench.scenes.builder import Item, Piece, moved
from puckbench.scenes.modeller import Modeller
from puckbench.scenes.solids import box, flat
from puckbench.scenes.surfaces import Surface, join

DOOR_DEPTH, PASSAGE_DEPTH, WINDOW_DEPTH = 0.14, 1.4, 0.2
CASING = 0.07


@dataclass(frozen=True)
class Opening:
    """A hole in a wall.

    Parameters
    ----------
    wall
        Number of the outline's edge.
    at
        Its middle, as a share of the wall's length from the edge's end.
    kind
        "passage" is a door that stands open onto a dead-end passage.
    width, height, sill
        Sizes, and height of the lower edge above the floor, m.
    """

    wall: int
    at: float
    kind: Literal["door", "passage", "window"] = "door"
    width: float = 0.95
    height: float = 2.08
    sill: float = 0.0

    def span(self, length: float) -> tuple[float, float]:
        """Where the opening begins and ends along a wall of this length."""
        return self.at * length - self.width / 2, self.at * length + self.width / 2


def window(
    wall: int, at: float, width: float = 1.4, height: float = 1.35, sill: float = 0.9
) -> Opening:
    """A window in a wall."""
    return Opening(wall, at, "window", width, height, sill)


def wall_frame(outline: Floats, wall: int) -> tuple[Floats, float]:
    """Pose (4, 4) and length of a wall: x along it, y outwards, z up, origin at the edge's end."""
    start, end = outline[wall], outline[(wall + 1) % len(outline)]
    length = float(np.linalg.norm(end - start))
    along = (start - end) / length
    pose = np.eye(4)
    pose[:2, 0] = along
    pose[:2, 1] = (-along[1], along[0])
    pose[:2, 3] = end
    return pose, length


def shell(cad: Modeller, outline: Floats, height: float, openings: tuple[Opening, ...]) -> Item:
    """Everything that bounds the room, fronts inwards."""
    ground = outlines.polygon(*[(float(x), float(y)) for x, y in outline])
    item = [Piece("floor", "floor", flat(ground))]
    item.append(Piece("ceiling", "ceiling", flat(ground).turned_inside_out().at(z=height)))
    for wall in range(len(outline)):
        pose, length = wall_frame(outline, wall)
        own = [one for one in openings if one.wall == wall]
        parts = [Piece("wall", "wall", _wall(length, height, own))]
        parts.append(Piece("skirting", "wall", _skirting(length, own)))
        for opening in own:
            middle = np.eye(4)
            middle[0, 3], middle[2, 3] = opening.at * length, opening.sill
            parts += moved(_FILLINGS[opening.kind](cad, opening), middle)
        item += moved([part for part in parts if len(part.surface.triangles)], pose)
    return item


def depth(opening: Opening) -> float:
    """How far an opening reaches behind its wall."""
    depths = {"door": DOOR_DEPTH, "passage": PASSAGE_DEPTH, "window": WINDOW_DEPTH}
    return depths[opening.kind]


def _wall(length: float, height: float, openings: list[Opening]) -> Surface:
    """The plane of a wall with holes, and the sides of the holes."""
    border: list[outlines.Point] = [(0.0, 0.0)]
    holes = []
    for opening in sorted(openings, key=lambda one: one.at):
        x0, x1 = opening.span(length)
        low, high = opening.sill, opening.sill + opening.height
        if low > 0:
            holes.append(outlines.polygon((x0, low), (x1, low), (x1, high), (x0, high)))
        else:
            border += [(x0, 0.0), (x0, high), (x1, high), (x1, 0.0)]
    border += [(length, 0.0), (length, height), (0.0, height)]
    plane = flat(outlines.polygon(*border), holes).at(tilt=90)
    sides = [_sides(one).at(one.at * length, 0, one.sill) for one in openings]
    return join([plane, *sides])


def _sides(opening: Opening) -> Surface:
    """The four sides of a hole, fronts inwards."""
    reach = depth(opening)
    whole = box(opening.width, reach, opening.height).turned_inside_out().at(y=reach / 2)
    return whole.only(0, 1, 4, 5)


def _back(opening: Opening) -> Surface:
    """The plane that closes a hole at its back, front to the room."""
    reach = depth(opening)
    whole = box(opening.width, reach, opening.height).turned_inside_out().at(y=reach / 2)
    return whole.only(3)


def _skirting(length: float, openings: list[Opening]) -> Surface:
    """Boards along the foot of a wall, between its doors."""
    doors = sorted(one.span(length) for one in openings if one.sill == 0)
    starts = [0.0, *(x1 + CASING for _, x1 in doors)]
    ends = [*(x0 - CASING for x0, _ in doors), length]
    boards = [
        box(x1 - x0, 0.014, 0.085).at((x0 + x1) / 2, -0.007)
        for x0, x1 in zip(starts, ends, strict=True)
        if x1 - x0 > 0.02
    ]
    return join(boards) if boards else box(1, 1, 1).only()


def _casing(width: float, height: float) -> list[Surface]:
    """Frame around a door, proud of the wall."""
    sides = [
        box(CASING, 0.02, height + CASING).at(s * (width + CASING) / 2, -0.01) for s in (-1, 1)
    ]
    return [*sides, box(width, 0.02, CASING).at(y=-0.01, z=height)]


def door_leaf(cad: Modeller, width: float, height: float) -> Surface:
    """Door leaf with its front at y = 0: two raised panels and a lever handle on a plate."""
    board = box(width, 0.04, height).at(y=0.02)
    panels = [box(width * 0.68, 0.008, z).at(0, -0.004, at) for at, z in ((0.2, 0.65), (1.05, 0.8))]
    x = width / 2 - 0.07
    plate = cad.slab(0.045, 0.2, 0.008, 0.015).at(x, 0, 1.03, tilt=90)
    lever = cad.pipe([(x, 0, 1.05), (x, -0.055, 1.05), (x - 0.12, -0.055, 1.05)], 0.009, 0.02)
    hinges = [cad.cylinder(0.009, 0.09).at(-width / 2 + 0.004, -0.004, z) for z in (0.25, 1.7)]
    return join([board, *panels, plate, lever, *hinges])


def _door(cad: Modeller, opening: Opening) -> Item:
    """Closed door: leaf, casing and the plane behind the gaps."""
    leaf = door_leaf(cad, opening.width - 0.008, opening.height - 0.008).at(y=0.08, z=0.004)
    parts = [leaf, _back(opening), *_casing(opening.width, opening.height)]
    return [Piece("door", "door", join(parts))]


def _passage(cad: Modeller, opening: Opening) -> Item:
    """Door that stands open into a passage with a closed end."""
    leaf = door_leaf(cad, opening.width - 0.008, opening.height - 0.008)
    swung = leaf.at(x=opening.width / 2).at(
        -opening.width / 2 + 0.06, 0.12, 0.004, turn=cad.between(84, 89)
    )
    frame = join([swung, *_casing(opening.width, opening.height)])
    return [Piece("door", "door", frame), Piece("passage_end", "wall", _back(opening))]


def _window(cad: Modeller, opening: Opening) -> Item:
    """Window: pane at the back of the hole, frame, bars, handle, and a sill board."""
    width, height, y = opening.width, opening.height, WINDOW_DEPTH - 0.03
    bars = [box(0.06, 0.06, height).at(s * (width / 2 - 0.03), y) for s in (-1, 1)]
    bars += [box(width - 0.12, 0.06, 0.06).at(y=y, z=z) for z in (0.0, height - 0.06)]
    count = max(1, round(width / 0.75))
    xs = (np.arange(1, count) / count - 0.5) * width
    bars += [box(0.07, 0.05, height - 0.12).at(float(x), y + 0.005, 0.06) for x in xs]
    grip = cad.rod(
        (float(xs[0]) if len(xs) else 0.0, y - 0.05, height * 0.4),
        (float(xs[0]) if len(xs) else 0.0, y - 0.05, height * 0.52),
        0.01,
    )
    sill = cad.slab(width + 0.1, 0.09, 0.03, 0.02).at(y=-0.045, z=-0.03)
    frame = join([*bars, grip, sill])
    return [Piece("window_frame", "window", frame), Piece("window_pane", "window", _back(opening))]


_FILLINGS = {"door": _door, "passage": _passage, "window": _window}

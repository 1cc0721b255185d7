"""The ground of a street: a road with a crown, kerbs, pavements, yards and a junction at each end.

The road lies along x, its crown over y = 0, its gutters at z = 0. At both ends it meets a cross
street, beyond which the ground goes on. Every place has ground, and no two lie over each other.
"""

from __future__ import annotations

import numpy as np

from puckbench.scenes import outlines
from puckbench.scenes.builder import Item, Piece
from puckbench.scenes.modeller import Modeller
from puckbench.scenes.outlines import Outline, Point, Segment
from puckbench.scenes.solids import box, extrude, flat
from puckbench.scenes.surfaces import Surface, join, planar

LANE, PARKING = 3.25, 2.15
ROAD = LANE + PARKING
"""Width of a lane and of the parking strip beside it, and half the width of the road, m."""
CROWN = 0.025 * ROAD
"""Height of the road's middle over its gutters, m."""
KERB, PAVED = 0.12, 0.11
"""Height of the kerbs, and of the pavements and yards behind them, m."""
PROPERTY = ROAD + 3.2
"""Distance of the pavements' backs from the road's middle, m."""
SIDE = 32.0
"""Distance of the scene's long sides from the road's middle, m."""
CROSSING, BEYOND = 8.0, 16.0
"""Width of the cross streets, and depth of the ground beyond them, m."""
FAR_PAVED = 2.6
"""Width of the pavements beyond the cross streets, with their kerbs, m."""
_CORNER, _HIP, _STONE = 3.0, 6.0, 0.15


def road_height(y: float) -> float:
    """Height of the road at a distance from its middle, away from its ends, m."""
    return CROWN * (1 - abs(y) / ROAD)


def ground(cad: Modeller, length: float) -> Item:
    """The ground of a street, `length` m long between its cross streets."""
    half = _crowned(length)
    hip = _hip(length)
    item = [Piece("road", "road", join([half, half.mirrored(1), hip, hip.mirrored()]))]
    for kind, semantic, surface in (_junction(cad, length), *_block(cad, length), *_far(length)):
        item += [Piece(kind, semantic, one) for one in (surface, surface.at(turn=180))]
    return item


def _crowned(length: float) -> Surface:
    """The half of the road over y < 0."""
    x = length / 2 - _CORNER
    ridge = x - _HIP
    return _facet((-x, -ROAD, 0.0), (x, -ROAD, 0.0), (ridge, 0.0, CROWN), (-ridge, 0.0, CROWN))


def _hip(length: float) -> Surface:
    """The end of the road over x > 0, where its crown goes down to the cross street."""
    x = length / 2 - _CORNER
    return _facet((x, -ROAD, 0.0), (x, ROAD, 0.0), (x - _HIP, 0.0, CROWN))


def _junction(cad: Modeller, length: float) -> tuple[str, str, Surface]:
    """The cross street at the end of the road over x > 0, with rounded corners."""
    x, inner, y = length / 2, length / 2 - _CORNER, ROAD + _CORNER
    far, steps = x + CROSSING, cad.steps(_CORNER) // 4
    border = (
        *outlines.arc((inner, -y), _CORNER, 90, 0, steps),
        *outlines.line((x, -y), (x, -SIDE), (far, -SIDE), (far, SIDE), (x, SIDE), (x, y)),
        *outlines.arc((inner, y), _CORNER, 0, -90, steps),
        *outlines.line((inner, ROAD), (inner, -ROAD)),
    )
    return "junction", "road", flat(border)


def _block(cad: Modeller, length: float) -> list[tuple[str, str, Surface]]:
    """Kerb, pavement and yards along the side of the road over y > 0."""
    steps, x = cad.steps(_CORNER) // 4, length / 2 - _STONE
    outer, inner = (_edge(length, inset, SIDE, steps) for inset in (0.0, _STONE))
    ends = outlines.line(_last(outer), _last(inner)), outlines.line(_first(inner), _first(outer))
    stones = _uncovered(extrude((*outer, *ends[0], *_backwards(inner), *ends[1]), KERB))
    front = _edge(length, _STONE, PROPERTY, steps)
    paved = flat((*front, *outlines.line(_last(front), _first(front)))).at(z=PAVED)
    yards = _rectangle((-x, PROPERTY), (x, SIDE))
    return [("kerb", "kerb", stones), ("pavement", "pavement", paved), ("yards", "terrain", yards)]


def _far(length: float) -> list[tuple[str, str, Surface]]:
    """Kerb, pavement and yards beyond the cross street over x > 0."""
    x = length / 2 + CROSSING
    stones = _uncovered(box(_STONE, 2 * SIDE, KERB).at(x=x + _STONE / 2), base=4)
    paved = _rectangle((x + _STONE, -SIDE), (x + FAR_PAVED, SIDE))
    yards = _rectangle((x + FAR_PAVED, -SIDE), (x + BEYOND, SIDE))
    return [("kerb", "kerb", stones), ("pavement", "pavement", paved), ("yards", "terrain", yards)]


def _edge(length: float, inset: float, end: float, steps: int) -> Outline:
    """The edge of a block, `inset` m within it, from one side street to the other, to y = end."""
    x, inner, y = length / 2 - inset, length / 2 - _CORNER, ROAD + _CORNER
    return (
        *outlines.line((-x, end), (-x, y)),
        *outlines.arc((-inner, y), _CORNER - inset, 180, 270, steps),
        *outlines.line((-inner, ROAD + inset), (inner, ROAD + inset)),
        *outlines.arc((inner, y), _CORNER - inset, 270, 360, steps),
        *outlines.line((x, y), (x, end)),
    )


def _backwards(path: Outline) -> Outline:
    return tuple(
        Segment(one.kind, one.points[::-1], one.centre, one.radius) for one in reversed(path)
    )


def _first(path: Outline) -> Point:
    x, y = path[0].points[0]
    return (float(x), float(y))


def _last(path: Outline) -> Point:
    x, y = path[-1].points[-1]
    return (float(x), float(y))


def _uncovered(surface: Surface, base: int = 1) -> Surface:
    """A body that stands on the ground without its base, which is the shape of this number."""
    return surface.only(*(number for number in range(len(surface.shapes)) if number != base))


def _rectangle(low: Point, high: Point) -> Surface:
    """Paved or planted ground between two corners."""
    (x0, y0), (x1, y1) = low, high
    return _facet((x0, y0, PAVED), (x1, y0, PAVED), (x1, y1, PAVED), (x0, y1, PAVED))


def _facet(*corners: tuple[float, float, float]) -> Surface:
    """A plane convex polygon, its corners counter-clockwise seen from its front."""
    fan = [(0, k, k + 1) for k in range(1, len(corners) - 1)]
    return planar(np.array(corners), np.array(fan))

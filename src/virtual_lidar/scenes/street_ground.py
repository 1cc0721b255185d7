"""Ground of a street: a cambered road, kerbs, pavements, yards, and a junction at each end.

The road lies along x, with the crown above y = 0 and the gutters at z = 0. The parts neither
overlap nor leave gaps.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from virtual_lidar.scenes.bodies import Body, Item
from virtual_lidar.scenes.modeller import Modeller
from virtual_lidar.scenes.outlines import Outline, Point, arc, line, ring
from virtual_lidar.scenes.solids import box, extrude, flat
from virtual_lidar.scenes.surfaces import Surface, join, planar

LANE, PARKING = 3.25, 2.15
ROAD = LANE + PARKING
"""Widths of a lane and a parking strip, and half the width of the road, m."""
CROWN = 0.025 * ROAD
"""Height of the crown above the gutters, m."""
KERB, PAVEMENT_Z = 0.12, 0.11
"""Heights of kerbs, and of pavements and yards, m."""
PROPERTY_Y = ROAD + 3.2
"""Distance of the property line from the centre line, m."""
HALF_WIDTH = 32.0
"""Half the width of the scene, m."""
CROSS_STREET, END_DEPTH = 8.0, 16.0
"""Width of the cross streets, and of the ground beyond them, m."""
END_PAVEMENT = 2.6
"""Width of the pavements beyond the cross streets, m."""
_CORNER, _HIP, _STONE = 3.0, 6.0, 0.15


def road_height(y: float) -> float:
    """Return the road's height, m, at a distance from its centre line."""
    return CROWN * (1 - abs(y) / ROAD)


def ground(cad: Modeller, length: float) -> Item:
    """Make the ground of a street whose two cross streets are `length` metres apart."""
    x = length / 2 - _CORNER
    ridge = x - _HIP
    half = _facet((-x, -ROAD, 0.0), (x, -ROAD, 0.0), (ridge, 0.0, CROWN), (-ridge, 0.0, CROWN))
    hip = _facet((x, -ROAD, 0.0), (x, ROAD, 0.0), (ridge, 0.0, CROWN))
    item = [Body("road", "road", join([half, half.mirrored(1), hip, hip.mirrored()]))]
    for kind, semantic, surface in (_junction(cad, length), *_block(cad, length), *_far(length)):
        item += [Body(kind, semantic, part) for part in (surface, surface.at(turn=180))]
    return item


def _junction(cad: Modeller, length: float) -> tuple[str, str, Surface]:
    x, inner, y = length / 2, length / 2 - _CORNER, ROAD + _CORNER
    far, steps = x + CROSS_STREET, cad.steps(_CORNER) // 4
    corners = ((x, -HALF_WIDTH), (far, -HALF_WIDTH), (far, HALF_WIDTH), (x, HALF_WIDTH))
    border = (
        *arc((inner, -y), _CORNER, 90, 0, steps),
        *line((x, -y), *corners, (x, y)),
        *arc((inner, y), _CORNER, 0, -90, steps),
        *line((inner, ROAD), (inner, -ROAD)),
    )
    return "junction", "road", flat(border)


def _block(cad: Modeller, length: float) -> list[tuple[str, str, Surface]]:
    steps, x = cad.steps(_CORNER) // 4, length / 2 - _STONE
    outer, inner = (_edge(length, inset, HALF_WIDTH, steps) for inset in (0.0, _STONE))
    stones = _uncovered(extrude(ring(outer, _backwards(inner)), KERB))
    paved = flat(ring(_edge(length, _STONE, PROPERTY_Y, steps))).at(z=PAVEMENT_Z)
    yards = _rectangle((-x, PROPERTY_Y), (x, HALF_WIDTH))
    return [("kerb", "kerb", stones), ("pavement", "pavement", paved), ("yards", "terrain", yards)]


def _far(length: float) -> list[tuple[str, str, Surface]]:
    x = length / 2 + CROSS_STREET
    stones = _uncovered(box(_STONE, 2 * HALF_WIDTH, KERB).at(x=x + _STONE / 2), base=4)
    paved = _rectangle((x + _STONE, -HALF_WIDTH), (x + END_PAVEMENT, HALF_WIDTH))
    yards = _rectangle((x + END_PAVEMENT, -HALF_WIDTH), (x + END_DEPTH, HALF_WIDTH))
    return [("kerb", "kerb", stones), ("pavement", "pavement", paved), ("yards", "terrain", yards)]


def _edge(length: float, inset: float, end: float, steps: int) -> Outline:
    x, inner, y = length / 2 - inset, length / 2 - _CORNER, ROAD + _CORNER
    return (
        *line((-x, end), (-x, y)),
        *arc((-inner, y), _CORNER - inset, 180, 270, steps),
        *line((-inner, ROAD + inset), (inner, ROAD + inset)),
        *arc((inner, y), _CORNER - inset, 270, 360, steps),
        *line((x, y), (x, end)),
    )


def _backwards(path: Outline) -> Outline:
    return tuple(replace(segment, points=segment.points[::-1]) for segment in reversed(path))


def _uncovered(surface: Surface, base: int = 1) -> Surface:
    return surface.select(*(number for number in range(len(surface.shapes)) if number != base))


def _rectangle(low: Point, high: Point) -> Surface:
    (x0, y0), (x1, y1), z = low, high, PAVEMENT_Z
    return _facet((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z))


def _facet(*corners: tuple[float, float, float]) -> Surface:
    fan = [(0, k, k + 1) for k in range(1, len(corners) - 1)]
    return planar(np.array(corners), np.array(fan))

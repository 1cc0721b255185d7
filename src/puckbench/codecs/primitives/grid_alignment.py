"""Where the tree's grid lies against a cloud's walls: the places that are tried.

A wall that lies between two nodes, or crosses many of them at a corner, costs bits and error that
it would not cost half a node farther on. How much, only coding tells.
"""

from __future__ import annotations

from collections.abc import Iterator

from puckbench.codecs.primitives.encoder import Cloud, Way, cell_of, margins_of_points
from puckbench.codecs.primitives.manhattan_frame import best_turn

_MARGINS = (0.25, 0.75, 1.25, 1.75)
"""Cells between the grid's edge and the surface, along all axes: a least leaf is two cells."""
_SHIFTS = (-0.5, 0.5)
_COARSE = 12.0
"""Least leaves (units) from which on one place or another makes a difference."""


def first_ways(cloud: Cloud) -> list[Way]:
    """Along the cloud's axes, from the points' corner on or the surface's; along its walls."""
    turn = best_turn(cloud.surface.normals)
    ways = [Way(margins=margins_of_points(cloud)), Way()]
    return [*ways, Way(turn)] if any(turn) else ways


def other_margins(cloud: Cloud, way: Way) -> list[Way]:
    """The same axes, the grid elsewhere; none where leaves are small."""
    margins = _MARGINS if _coarse(cloud) else ()
    return [way._replace(margins=(margin, margin, margin)) for margin in margins]


def shifted(cloud: Cloud, way: Way, axis: int) -> Iterator[Way]:
    """The grid a little aside along one axis; none where leaves are small."""
    for shift in _SHIFTS if _coarse(cloud) else ():
        margins = list(way.margins)
        margins[axis] += shift
        if margins[axis] >= 0:
            yield way._replace(margins=(margins[0], margins[1], margins[2]))


def _coarse(cloud: Cloud) -> bool:
    return max(cloud.settings.leaf, 2 * cell_of(cloud)) >= _COARSE

"""Grid alignment: candidate positions and axes of the octree's grid with respect to the walls.

A wall that lies between two nodes, or crosses many of them near their corners, costs more bits and
error than half a node farther on. How much is found by coding.
"""

from __future__ import annotations

from collections.abc import Iterator

from puckbench.primitives.manhattan_frame import estimate_manhattan_frame
from puckbench.primitives.preparation import PreparedCloud, column_size_of
from puckbench.primitives.surface_mode import SurfaceMode, margins_from_points

_MARGINS = (0.25, 0.75, 1.25, 1.75)
"""Margins in columns, equal along all axes; a smallest leaf is two columns or more."""
_SHIFTS = (-0.5, 0.5)
_MIN_LEAF_SIZE = 12.0
"""Smallest leaves, in units, from which on the alignment makes a difference."""


def frame_candidates(cloud: PreparedCloud) -> list[SurfaceMode]:
    """Grids along the cloud's axes, from its points' or its surface's corner, and along walls."""
    rotation = estimate_manhattan_frame(cloud.surface.normals)
    modes = [SurfaceMode(margins=margins_from_points(cloud)), SurfaceMode()]
    return [*modes, SurfaceMode(rotation)] if any(rotation) else modes


def margin_candidates(cloud: PreparedCloud, mode: SurfaceMode) -> list[SurfaceMode]:
    """The same axes with other margins; none where leaves are small."""
    margins = _MARGINS if _has_large_leaves(cloud) else ()
    return [mode._replace(margins=(margin, margin, margin)) for margin in margins]


def shift_candidates(cloud: PreparedCloud, mode: SurfaceMode, axis: int) -> Iterator[SurfaceMode]:
    """The grid shifted along one axis; none where leaves are small."""
    for shift in _SHIFTS if _has_large_leaves(cloud) else ():
        margins = list(mode.margins)
        margins[axis] += shift
        if margins[axis] >= 0:
            yield mode._replace(margins=(margins[0], margins[1], margins[2]))


def _has_large_leaves(cloud: PreparedCloud) -> bool:
    return max(cloud.settings.min_leaf_size, 2 * column_size_of(cloud)) >= _MIN_LEAF_SIZE

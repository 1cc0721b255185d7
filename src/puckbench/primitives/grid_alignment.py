"""Grid alignment: candidate axes and offsets of the octree's grid relative to the walls.

Walls between octree nodes, or through many node corners, cost more bits and error than walls
through the middle of nodes.
"""

from __future__ import annotations

from collections.abc import Iterator

from puckbench.primitives.manhattan_frame import estimate_manhattan_frame
from puckbench.primitives.preparation import PreparedCloud, axis_aligned_column_size
from puckbench.primitives.surface_mode import SurfaceMode, point_corner_offset

_DIAGONAL_OFFSETS = (0.25, 0.75, 1.25, 1.75)
"""Grid offsets in columns, equal along all axes. Leaves are at least two columns wide."""
_AXIS_OFFSETS = (-0.5, 0.5)
_MIN_ALIGNED_LEAF_SIZE = 12.0
"""Side of the smallest leaves, in units, below which alignment makes no difference."""


def frame_candidates(cloud: PreparedCloud) -> list[SurfaceMode]:
    """Return candidates with grids along the cloud's axes and along its Manhattan frame.

    Grids along the cloud's axes begin at the points' or the surface's lowest corner.
    """
    rotation = estimate_manhattan_frame(cloud.surface.normals)
    modes = [SurfaceMode(grid_offset=point_corner_offset(cloud)), SurfaceMode()]
    return [*modes, SurfaceMode(rotation)] if any(rotation) else modes


def diagonal_offset_candidates(cloud: PreparedCloud, mode: SurfaceMode) -> list[SurfaceMode]:
    """Return candidates with `_DIAGONAL_OFFSETS`, or none if the leaves are small."""
    offsets = _DIAGONAL_OFFSETS if _has_large_leaves(cloud) else ()
    return [mode._replace(grid_offset=(offset, offset, offset)) for offset in offsets]


def axis_offset_candidates(
    cloud: PreparedCloud, mode: SurfaceMode, axis: int
) -> Iterator[SurfaceMode]:
    """Yield candidates with the grid moved along an axis, or none if the leaves are small."""
    for step in _AXIS_OFFSETS if _has_large_leaves(cloud) else ():
        offset = list(mode.grid_offset)
        offset[axis] += step
        if offset[axis] >= 0:
            yield mode._replace(grid_offset=(offset[0], offset[1], offset[2]))


def _has_large_leaves(cloud: PreparedCloud) -> bool:
    return (
        max(cloud.settings.min_leaf_size, 2 * axis_aligned_column_size(cloud))
        >= _MIN_ALIGNED_LEAF_SIZE
    )

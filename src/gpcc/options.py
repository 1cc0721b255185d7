"""Options of the octree encoder, with TMC13's names, and named sets of options."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pointkit.models import Model

_Log2 = Annotated[int, Field(ge=0, le=21)]
_PlanarThreshold = Annotated[int, Field(ge=0, le=127)]


class GpccOptions(Model):
    """Options of the octree encoder, which have the names and meanings of TMC13's.

    The defaults code occupancies with contexts from neighbouring nodes, and use no other coding
    tool.
    """

    neighbour_avail_boundary_log2: Annotated[int, Field(ge=0, le=8)] = Field(
        8,
        description="log2 of the side, in nodes, of the cube in which neighbours are available; "
        "below 2 only siblings are, and the next two options have no effect",
    )
    adjacent_child_contextualization: bool = Field(
        True, description="use contexts from the children of neighbours coded before"
    )
    intra_pred_max_node_size_log2: _Log2 = Field(
        0, description="nodes with a smaller log2 of their side are predicted from neighbours"
    )
    planar: bool = Field(False, description="use the planar coding mode")
    planar_thresholds: tuple[_PlanarThreshold, _PlanarThreshold, _PlanarThreshold] = Field(
        (77, 99, 113),
        description="lowest rates of planar nodes along the most, second and least planar axis at "
        "which the mode is used, of 127",
    )
    qtbt: bool = Field(
        False, description="split a box instead of a cube (quadtree and binary tree)"
    )
    max_num_qtbt_before_ot: Annotated[int, Field(ge=0, le=63)] = Field(
        4, description="number of first levels that split only the longest sides"
    )
    min_qtbt_size_log2: _Log2 = Field(
        0, description="log2 of the shortest side at which nodes split only their longest sides"
    )
    angular_max_node_min_dim_log2_to_split_z: _Log2 = Field(
        8,
        description="with a sensor: log2 of the largest height of nodes whose split along z is "
        "deferred",
    )
    angular_max_diff_to_split_z: _Log2 = Field(
        1, description="with a sensor: log2 of the smallest ratio of height to width of these nodes"
    )
    planar_buffer: bool = Field(
        True, description="with a sensor: use contexts from planes coded before"
    )
    inferred_direct_coding_mode: Annotated[int, Field(ge=0, le=3)] = Field(
        0,
        description="nodes whose points may be coded directly: 0 none, 1 isolated, 2 without "
        "neighbours, 3 any",
    )
    planar_mode_idcm_use: Annotated[int, Field(ge=0, le=32)] = Field(
        0, description="share of isolated nodes, in 32nds, that mode 1 may code directly"
    )
    joint_two_point_idcm: bool = Field(
        True, description="code common leading bits of two direct points once"
    )
    merge_duplicates: bool = Field(True, description="keep one of several equal points")
    slice_max_points: Annotated[int, Field(ge=1, le=1 << 24)] = Field(
        1_100_000, description="maximum number of points in a slice"
    )


PROFILES = {
    "minimal": GpccOptions(),
    "ctc": GpccOptions(planar=True, qtbt=True, intra_pred_max_node_size_log2=6),
    "defaults": GpccOptions(planar=True, qtbt=True, neighbour_avail_boundary_log2=0),
}
"""Named sets of options.

``minimal`` is an octree with contexts from neighbours and adjacent children only, ``ctc`` follows
MPEG's common test conditions, and ``defaults`` is TMC13 without options.
"""

SPINNING = {
    "inferred_direct_coding_mode": 3,
    "max_num_qtbt_before_ot": 6,
    "planar_mode_idcm_use": 32,
    "merge_duplicates": False,
    "planar_buffer": False,
}
"""Options in which lossless coding of spinning sensors differs from `ctc` in MPEG's conditions.

For lossy coding, the conditions also merge duplicates and use IDCM only for isolated nodes.
"""
PROFILES["spinning"] = PROFILES["ctc"].model_copy(update=SPINNING)

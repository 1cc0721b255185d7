"""Encoder options, named as in TMC13, and profiles of them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from puckbench.core.models import Model

_PlanarThreshold = Annotated[int, Field(ge=0, le=127)]


class GpccOptions(Model):
    """Coding tools of octree geometry."""

    neighbour_avail_boundary_log2: int = Field(
        default=8,
        ge=0,
        le=8,
        description="neighbours count within cubes of 2^this nodes; below 2 only siblings do, and "
        "the next two options have no effect",
    )
    adjacent_child_contextualization: bool = Field(
        default=True, description="contexts from the children of neighbours coded before"
    )
    intra_pred_max_node_size_log2: int = Field(
        default=0, ge=0, le=21, description="smaller nodes are predicted from their neighbours"
    )
    planar: bool = Field(default=False, description="planar coding mode")
    planar_thresholds: tuple[_PlanarThreshold, _PlanarThreshold, _PlanarThreshold] = Field(
        default=(77, 99, 113),
        description="rates of planes that the most, second and least frequent axis need",
    )
    qtbt: bool = Field(default=False, description="the root is a box instead of a cube")
    max_num_qtbt_before_ot: int = Field(
        default=4, ge=0, le=63, description="levels that first split the longest sides alone"
    )
    min_qtbt_size_log2: int = Field(
        default=0, ge=0, le=21, description="nodes with such a side split only their longest sides"
    )
    angular_max_node_min_dim_log2_to_split_z: int = Field(
        default=8,
        ge=0,
        le=21,
        description="with a sensor: log2 of the height up to which nodes are split late along z",
    )
    angular_max_diff_to_split_z: int = Field(
        default=1, ge=0, le=21, description="with a sensor: log2 of height / width to be split late"
    )
    planar_buffer: bool = Field(
        default=True, description="with a sensor: contexts also from planes coded before"
    )
    inferred_direct_coding_mode: int = Field(
        default=0,
        ge=0,
        le=3,
        description="0 off, 1 isolated nodes, 2 nodes without neighbours, 3 any node",
    )
    planar_mode_idcm_use: int = Field(
        default=0, ge=0, le=32, description="isolated nodes of 32 that mode 1 may code directly"
    )
    joint_two_point_idcm: bool = Field(
        default=True, description="common leading bits of two direct points are coded once"
    )
    merge_duplicates: bool = Field(default=True, description="keep one of equal points, else all")
    slice_max_points: int = Field(
        default=1_100_000, ge=1, le=1 << 24, description="points in a slice, at most"
    )


PROFILES = {
    "minimal": GpccOptions(),
    "ctc": GpccOptions(planar=True, qtbt=True, intra_pred_max_node_size_log2=6),
    "defaults": GpccOptions(planar=True, qtbt=True, neighbour_avail_boundary_log2=0),
}
"""minimal: octree with neighbour and adjacent-child contexts only. ctc: MPEG's common test
conditions. defaults: TMC13 without options."""

SPINNING = {
    "inferred_direct_coding_mode": 3,
    "max_num_qtbt_before_ot": 6,
    "planar_mode_idcm_use": 32,
    "merge_duplicates": False,
    "planar_buffer": False,
}
"""Changes of `ctc` by MPEG's common test conditions for lossless coding of spinning sensors.

For lossy coding these conditions merge duplicates and use IDCM only for isolated nodes."""
PROFILES["spinning"] = PROFILES["ctc"].model_copy(update=SPINNING)

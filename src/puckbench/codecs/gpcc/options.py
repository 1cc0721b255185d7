"""The encoder's choices, by the reference software's names, and the profiles in use."""

from __future__ import annotations

from dataclasses import dataclass

from puckbench.core.errors import InputError


@dataclass(frozen=True)
class GpccOptions:
    """Coding tools of octree geometry.

    neighbour_avail_boundary_log2: neighbours count within cubes of so many bits of node
    positions, 2..8; below 2 only siblings do, and the next two options have no effect.
    intra_pred_max_node_size_log2: nodes smaller than this are predicted from their neighbours.
    planar_thresholds: 0..127, how frequent planes must be for planar mode to be tried. qtbt:
    boxes instead of cubes, of which the first max_num_qtbt_before_ot levels and all nodes with a
    side of min_qtbt_size_log2 are split along their longest sides alone. inferred_direct_coding
    _mode: 0 off, 1 isolated nodes (planar_mode_idcm_use of 32 of them), 2 nodes without
    neighbours, 3 any node. merge_duplicates: keep one of equal points, else all.
    slice_max_points: most points in one slice.
    """

    neighbour_avail_boundary_log2: int = 8
    adjacent_child_contextualization: bool = True
    intra_pred_max_node_size_log2: int = 0
    planar: bool = False
    planar_thresholds: tuple[int, int, int] = (77, 99, 113)
    qtbt: bool = False
    max_num_qtbt_before_ot: int = 4
    min_qtbt_size_log2: int = 0
    inferred_direct_coding_mode: int = 0
    planar_mode_idcm_use: int = 0
    joint_two_point_idcm: bool = True
    merge_duplicates: bool = True
    slice_max_points: int = 1_100_000

    def __post_init__(self) -> None:
        ranges = {
            "neighbour_avail_boundary_log2": (0, 8),
            "intra_pred_max_node_size_log2": (0, 21),
            "max_num_qtbt_before_ot": (0, 63),
            "min_qtbt_size_log2": (0, 21),
            "inferred_direct_coding_mode": (0, 3),
            "planar_mode_idcm_use": (0, 32),
            "slice_max_points": (1, 1 << 24),
        }
        for name, (least, most) in ranges.items():
            if not least <= getattr(self, name) <= most:
                raise InputError(f"G-PCC option {name} must be from {least} to {most}")
        if any(not 0 <= threshold <= 127 for threshold in self.planar_thresholds):
            raise InputError("G-PCC option planar_thresholds must be from 0 to 127")


PROFILES = {
    "minimal": GpccOptions(),
    "ctc": GpccOptions(planar=True, qtbt=True, intra_pred_max_node_size_log2=6),
    "defaults": GpccOptions(planar=True, qtbt=True, neighbour_avail_boundary_log2=0),
}
"""minimal: octree with neighbour and adjacent-child contexts alone. ctc: MPEG's common test
conditions. defaults: what TMC13 does when it is told nothing."""

"""Segmentation: leaves merged to larger planes, so that a wall is one segment."""

from __future__ import annotations

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.primitives.decoder import Patches, plane_points, revolution_points
from puckbench.primitives.octree import moments_of
from puckbench.primitives.octree_arrays import Ints
from puckbench.primitives.region_merging import MergeLimits, adjacent_leaves, merge_regions

_MIN_COSINE = float(np.cos(np.radians(20)))
_CHUNK = 1 << 18
"""Points whose moments are in memory together."""
_MAX_ADDED_DISTANCE = 0.2
"""Squared distance, in columns, that a merge may add for each point of the smaller segment."""


def segment_points(patches: Patches) -> tuple[Floats, Ints]:
    """Points (m, 3) of planes and surfaces of revolution, and the segment (m,) of each."""
    xyz, leaf_of_point = plane_points(patches)
    _, segments = np.unique(
        _merged_leaves(patches, xyz, leaf_of_point)[leaf_of_point], return_inverse=True
    )
    revolutions = revolution_points(patches)
    count = len(np.unique(segments))
    numbers = [np.full(len(part.xyz), count + k) for k, part in enumerate(revolutions)]
    return np.concatenate([xyz, *(part.xyz for part in revolutions)]), np.concatenate(
        [segments, *numbers]
    )


def leaf_segments(patches: Patches) -> Ints:
    """The segment (n,) of each leaf: the index of one of its leaves."""
    return _merged_leaves(patches, *plane_points(patches))


def _merged_leaves(patches: Patches, xyz: Floats, leaf_of_point: Ints) -> Ints:
    """`leaf_segments` of patches whose points (m, 3) lie on the leaves leaf_of_point (m,)."""
    moments = np.zeros((int(patches.leaves.counts[0]), 10))
    middle = xyz.mean(axis=0) if len(xyz) else np.zeros(3)
    for first in range(0, len(xyz), _CHUNK):
        rows = slice(first, first + _CHUNK)
        own = moments_of((xyz[rows] - middle) / patches.header.cell_size)
        np.add.at(moments, leaf_of_point[rows], own)
    pairs = adjacent_leaves(patches.leaves, patches.geometry.shape)
    occupied = moments[:, 0] > 0
    pairs = pairs[occupied[pairs].all(axis=1)]
    return np.asarray(
        merge_regions(moments, pairs, MergeLimits(0.0, _MAX_ADDED_DISTANCE, _MIN_COSINE))
    )

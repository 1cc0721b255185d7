from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import Floats
from primitive_codec.decoder import Patches, reconstruct_planes, reconstruct_revolutions
from primitive_codec.octree import moments_of
from primitive_codec.octree_arrays import Ints
from primitive_codec.region_merging import MergeLimits, adjacent_leaves, merge_regions

_MIN_COSINE = float(np.cos(np.radians(20)))
_CHUNK = 1 << 18
"""Number of points whose moments are computed at once."""
_MAX_ADDED_ERROR = 0.2
"""Largest squared error that a merge may add per point of the smaller segment, in squared
columns."""


def segment_points(patches: Patches) -> tuple[Floats, Ints]:
    """Return the points (m, 3) of all primitives, and their segment indices (m,)."""
    xyz, leaf_of_point = reconstruct_planes(patches)
    leaf_segments = _merge_leaves(patches, xyz, leaf_of_point)
    plane_segments, segments = np.unique(leaf_segments[leaf_of_point], return_inverse=True)
    points, indices = [xyz], [segments]
    for k, revolution in enumerate(reconstruct_revolutions(patches), start=len(plane_segments)):
        points.append(revolution.xyz)
        indices.append(np.full(len(revolution.xyz), k))
    return np.concatenate(points), np.concatenate(indices)


def segment_leaves(patches: Patches) -> Ints:
    """Return each leaf's segment (n,), as the index of one leaf of the segment."""
    return _merge_leaves(patches, *reconstruct_planes(patches))


def _merge_leaves(patches: Patches, xyz: Floats, leaf_of_point: Ints) -> Ints:
    moments = np.zeros((int(patches.octree.leaves.counts[0]), 10))
    centre = xyz.mean(axis=0) if len(xyz) else np.zeros(3)
    for first in range(0, len(xyz), _CHUNK):
        rows = slice(first, first + _CHUNK)
        point_moments = moments_of((xyz[rows] - centre) / patches.header.cell_size)
        np.add.at(moments, leaf_of_point[rows], point_moments)
    pairs = adjacent_leaves(patches.octree.leaves, patches.octree.geometry.shape)
    is_occupied = moments[:, 0] > 0
    pairs = pairs[is_occupied[pairs].all(axis=1)]
    limits = MergeLimits(0.0, _MAX_ADDED_ERROR, _MIN_COSINE)
    return np.asarray(merge_regions(moments, pairs, limits))

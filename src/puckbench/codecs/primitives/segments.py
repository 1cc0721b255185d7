"""Leaves joined to larger planes: what a wall is, whatever number of leaves it was coded in."""

from __future__ import annotations

import numpy as np

from puckbench.codecs.primitives.decoder import Patches, points_of, points_of_rounds
from puckbench.codecs.primitives.layout import Ints
from puckbench.codecs.primitives.regions import Limits, joined, touching
from puckbench.codecs.primitives.tree import moments_of
from puckbench.geometry.cloud import Floats

_PARALLEL = float(np.cos(np.radians(20)))
_OFF = 0.2
"""Squared distance, in cells, that a segment may grow by for each point of the smaller part."""


def labelled(patches: Patches) -> tuple[Floats, Ints]:
    """Points (m, 3) of planes and round surfaces, and a number (m,) for each segment of either."""
    xyz, rows = points_of(patches)
    _, names = np.unique(_joined(patches, xyz, rows)[rows], return_inverse=True)
    wraps = points_of_rounds(patches)
    after = len(np.unique(names))
    numbers = [np.full(len(part.xyz), after + k) for k, part in enumerate(wraps)]
    return np.concatenate([xyz, *(part.xyz for part in wraps)]), np.concatenate([names, *numbers])


def joined_leaves(patches: Patches) -> Ints:
    """A representative leaf for each leaf (n,), the same for all leaves of a segment."""
    return _joined(patches, *points_of(patches))


def _joined(patches: Patches, xyz: Floats, rows: Ints) -> Ints:
    """`joined_leaves` of patches with points (m, 3) on leaves `rows` (m,)."""
    moments = np.zeros((int(patches.leaves.counts[0]), 10))
    np.add.at(moments, rows, moments_of((xyz - xyz.mean(axis=0)) / patches.header.unit))
    pairs = touching(patches.leaves, patches.frame.shape)
    filled = moments[:, 0] > 0
    pairs = pairs[filled[pairs].all(axis=1)]
    return np.asarray(joined(moments, pairs, Limits(0.0, _OFF, _PARALLEL)))

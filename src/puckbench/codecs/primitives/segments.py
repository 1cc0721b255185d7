"""Leaves joined to larger planes: what a wall is, whatever number of leaves it was coded in."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.cloud import Floats
from puckbench.codecs.moments import fit_plane
from puckbench.codecs.primitives.decoder import Patches, points_of, points_of_rounds
from puckbench.codecs.primitives.layout import Frame, Ints, Leaves, Owners
from puckbench.codecs.primitives.tree import moments_of
from puckbench.compiling import compiled

_PARALLEL = float(np.cos(np.radians(10)))
_NEAR = 1.0
"""Cells that a leaf's middle may lie off the plane of the leaf beside it."""


class Segments(NamedTuple):
    """Planes (s, 4) of joined leaves, n.p = d in the cloud's coordinates, and decoded points.

    xyz: (m, 3). labels: (m,) the segment of each point.
    """

    planes: Floats
    xyz: Floats
    labels: Ints


def segmented(patches: Patches) -> Segments:
    """Join leaves that touch and go on from one another; planes of least squares of the joined."""
    xyz, rows = points_of(patches)
    _, labels = np.unique(joined_leaves(patches)[rows], return_inverse=True)
    order = np.argsort(labels, kind="stable")
    starts = np.flatnonzero(np.diff(labels[order], prepend=-1))
    middle = xyz.mean(axis=0)
    moments = np.add.reduceat(moments_of(xyz[order] - middle), starts, axis=0)
    planes = np.empty((len(starts), 4))
    for segment, plane in zip(moments, planes, strict=True):
        fit_plane(segment, plane)
        plane[3] += plane[:3] @ middle
    return Segments(planes, xyz, labels)


def labelled(patches: Patches) -> tuple[Floats, Ints]:
    """Points (m, 3) of planes and round surfaces, and a number (m,) for each segment of either."""
    xyz, rows = points_of(patches)
    _, names = np.unique(joined_leaves(patches)[rows], return_inverse=True)
    wraps = points_of_rounds(patches)
    after = len(np.unique(names))
    numbers = [np.full(len(part.xyz), after + k) for k, part in enumerate(wraps)]
    return np.concatenate([xyz, *(part.xyz for part in wraps)]), np.concatenate([names, *numbers])


def joined_leaves(patches: Patches) -> Ints:
    """A representative leaf for each leaf (n,), the same for all leaves of a segment."""
    return np.asarray(_joined(patches.frame, patches.leaves, patches.owner))


@compiled
def _joined(frame: Frame, leaves: Leaves, owner: Owners) -> Ints:
    parent = np.arange(leaves.counts[0])
    for i in range(leaves.counts[0]):
        low = np.maximum(leaves.corner[i] - 1, 0)
        high = np.minimum(leaves.corner[i] + leaves.side[i], frame.shape - 1)
        for x in range(low[0], high[0] + 1):
            for y in range(low[1], high[1] + 1):
                for z in range(low[2], high[2] + 1):
                    j = owner[x, y, z] - 1
                    if j > i and _root(parent, i) != _root(parent, j) and _go_on(leaves, i, j):
                        parent[_root(parent, j)] = _root(parent, i)
    for i in range(len(parent)):
        parent[i] = _root(parent, i)
    return parent


@compiled
def _root(parent: Ints, i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@compiled
def _go_on(leaves: Leaves, i: int, j: int) -> bool:
    """Whether two leaves' planes are nearly parallel and each passes the other's middle."""
    a, b = leaves.planes[leaves.plane[i]], leaves.planes[leaves.plane[j]]
    if abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) < _PARALLEL:
        return False
    return _off(leaves, i, b) <= _NEAR and _off(leaves, j, a) <= _NEAR


@compiled
def _off(leaves: Leaves, i: int, plane: Floats) -> float:
    """Distance from a plane to the foot of a leaf's centre on its own plane."""
    own = leaves.planes[leaves.plane[i]]
    off = own[3]
    for k in range(3):
        off -= own[k] * (leaves.corner[i, k] + leaves.side[i] / 2)
    distance = -plane[3]
    for k in range(3):
        distance += plane[k] * (leaves.corner[i, k] + leaves.side[i] / 2 + off * own[k])
    return float(abs(distance))

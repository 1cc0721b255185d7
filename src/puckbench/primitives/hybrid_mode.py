"""Hybrid mode: a surface, and voxels that say where on it and how far off it the points lie.

A surface leaves out where on it the points are, and their noise; voxels know both, but not the
surface as precisely. Together: each voxel moves along the surface's normal, by a share of its
distance that the stream holds for each class of distances, and the surface keeps those of its own
points that lie in occupied voxels, which makes the decoded cloud as dense as the coded one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import chain, pairwise
from typing import NamedTuple

import numpy as np

from puckbench.core.errors import InputError
from puckbench.core.threads import in_threads
from puckbench.geometry.bounded_search import nearest_within
from puckbench.geometry.box_tree import BoxTree, box_tree
from puckbench.geometry.cloud import Floats
from puckbench.gpcc.tree import bounds
from puckbench.primitives import voxel_mode
from puckbench.primitives.cells import cell_keys, look_up_cells
from puckbench.primitives.displacements import LocalPlanes
from puckbench.primitives.distortion import Distortion, Nearest
from puckbench.primitives.octree_arrays import Ints
from puckbench.primitives.stream import (
    CLASSES,
    MAX_HYBRID_VOXELS,
    GridPlacement,
    HybridHeader,
    pack_hybrid,
)
from puckbench.primitives.voxel_mode import CodedVoxels, VoxelSearch

_DISTANCES = np.array([0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0, 1.25, 1.5, 2.0])
"""Borders in voxels of the classes of distances along the normal."""
_BESIDE = 1.0
"""Distance in voxels across the normal from which on the surface is beside a voxel, not below."""
_REACHES = (0, 6, 7, 8)
"""Half sides of the cube around a voxel's centre in which surface points are kept, in sixteenths
of a voxel: the whole voxel at most."""
_MAX_POINTS = 1.25
"""Decoded points for each coded one, at most."""
_MIN_VOXEL_SHARE = 0.1
"""Share of the budget that is left for voxels, below which no voxels are worth their header."""

_MAX_LOOKED_AT = 1 << 28
"""Points and boxes that the search below all voxels may look at: a second or two of work."""


class SurfacePart(NamedTuple):
    """A stream of surfaces, and the points (m, 3) and unit normals that it decodes to."""

    stream: bytes
    xyz: Floats
    normals: Floats


class Criterion(NamedTuple):
    """How hybrids are compared with each other.

    nearest: what is nearest among some decoded points (k, 3). measure: distortion of decoded points
    (k, 3), given what is nearest among them. cost: of a distortion, which is minimised.
    """

    nearest: Callable[[Floats], Nearest]
    measure: Callable[[Floats, Nearest], Distortion]
    cost: Callable[[Distortion], float]


class Hybrid(NamedTuple):
    """A stream, its distortion, and the cost of that."""

    cost: float
    distortion: Distortion
    stream: bytes


def decode(header: HybridHeader, xyz: Floats, normals: Floats) -> Floats:
    """Points (k, 3) of a hybrid stream, whose surface has points xyz (m, 3) with normals.

    Raises
    ------
    InputError
        If the stream is damaged.
    """
    place, voxels, points = voxel_mode.decoded_voxels(header.voxels)
    if len(voxels) and len(xyz):
        if not np.isfinite(xyz).all():
            raise InputError("the stream is damaged (points of its surface are not finite)")
        planes = _planes_below(points, xyz, box_tree(xyz), normals, place.cell_size)
        points = planes.moved(points, header.factors, place.cell_size)
        kept = xyz[_off_centre(xyz, place, voxels) < header.reach / 16]
        points = np.concatenate([points, kept])
    if not len(points) or not np.isfinite(points).all():
        raise InputError("the stream is damaged (it has no points, or some that are not finite)")
    return points


def encode(
    search: VoxelSearch,
    surface: SurfacePart,
    max_bytes: int,
    max_voxel_size: float,
    criterion: Criterion,
) -> Hybrid | None:
    """Code a cloud as a surface and the finest voxels that fit beside it.

    Parameters
    ----------
    search
        Of voxels of the cloud.
    surface
        The coded surface.
    max_bytes
        Budget of the whole stream.
    max_voxel_size
        As of `VoxelSearch.to_budget`.
    criterion
        By which the kept points of the surface are chosen.

    Returns
    -------
    Hybrid or None
        The best choice; None if the surface leaves too few bytes, or too many voxels fit.
    """
    if not leaves_voxels(surface.stream, max_bytes):
        return None
    voxels = search.to_budget(max_bytes - len(surface.stream), max_voxel_size)
    if len(voxels.points) > MAX_HYBRID_VOXELS:
        return None
    with suppress(InputError):  # of voxels too far from the surface
        return _best_choice(len(search.points), surface, voxels, criterion)
    return None


def leaves_voxels(surface: bytes, max_bytes: int) -> bool:
    """Whether the stream of a surface leaves bytes for voxels that are worth their header."""
    return max_bytes - len(surface) >= _MIN_VOXEL_SHARE * max_bytes


def _best_choice(
    count: int, surface: SurfacePart, coded: CodedVoxels, criterion: Criterion
) -> Hybrid:
    """The hybrid of least cost of a surface and voxels, displaced or not, by reach.

    The points that a greater reach adds are looked up alone, and once for both kinds of voxels.
    count: of the cloud's points.
    """
    place, groups = coded.place, coded.groups
    tree, weights = box_tree(surface.xyz), voxel_mode.weights_of(groups)
    off_centre = 16 * _off_centre(surface.xyz, place, groups.cells)
    added: dict[int, Nearest] = {}
    for less, reach in pairwise(_REACHES):
        shell = surface.xyz[(off_centre >= less) & (off_centre < reach)]
        if len(shell):
            added[reach] = criterion.nearest(shell)

    def choices(voxels: CodedVoxels) -> Iterator[Hybrid]:
        placed = voxels.points
        planes = _planes_below(placed, surface.xyz, tree, surface.normals, place.cell_size)
        apart = (placed - place.origin) / place.cell_size - groups.means
        factors, _ = planes.fitted(apart, weights)
        moved = planes.moved(placed, factors, place.cell_size)
        nearest = criterion.nearest(moved)
        for reach in _REACHES:
            decoded = np.concatenate([moved, surface.xyz[off_centre < reach]])
            if len(decoded) > _MAX_POINTS * count:
                break
            nearest = nearest.or_nearer(added[reach]) if reach in added else nearest
            distortion = criterion.measure(decoded, nearest)
            header = HybridHeader(reach, factors, surface.stream, voxels.stream)
            yield Hybrid(criterion.cost(distortion), distortion, pack_hybrid(header))

    kinds = [coded, coded.undisplaced()] if coded.table else [coded]
    found = in_threads(lambda voxels: list(choices(voxels)), kinds)
    return min(chain.from_iterable(found), key=lambda choice: choice.cost)


def _planes_below(
    points: Floats, xyz: Floats, tree: BoxTree, normals: Floats, cell_size: float
) -> LocalPlanes:
    """The surface at its nearest point to each of some points (m, 3); distances in voxels.

    xyz, tree, normals: points (k, 3) of the surface, their search tree, their normals. InputError
    for voxels that are all about as far from much of the surface, as near the centre of a sphere.
    """
    found = nearest_within(points, tree, _MAX_LOOKED_AT)
    if found is None:
        raise InputError("the stream is damaged, or its voxels lie too far from its surface")
    distance, row = found
    along = normals[row]
    offset = ((points - xyz[row]) * along).sum(axis=1) / cell_size
    across = (distance / cell_size) ** 2 - offset**2
    classes = 2 * np.searchsorted(_DISTANCES, np.abs(offset)) + (across > _BESIDE**2)
    return LocalPlanes(along, offset, classes)


def _off_centre(xyz: Floats, place: GridPlacement, voxels: Ints) -> Floats:
    """Distance along an axis, at most, of points (m, 3) from the centre of their voxel, (m,).

    In voxels; infinite where no voxel is occupied.
    """
    found = np.empty(len(xyz))
    low, high = bounds(voxels)
    look_up_cells(xyz, place.origin, place.cell_size, cell_keys(voxels - low), (low, high), found)
    return found


assert 2 * (len(_DISTANCES) + 1) == CLASSES  # noqa: S101

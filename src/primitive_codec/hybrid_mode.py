"""Hybrid mode: codes a surface, and voxels that locate the input points on and near this surface.

A surface alone loses the positions and the noise of the points. Voxels alone keep both, but locate
the surface less precisely. In a hybrid, the decoder moves each voxel along the normal of the
nearest surface point, by a fraction of their distance; the stream has one fraction for each class
of distances. The decoder also keeps the surface points that lie in occupied voxels, so that the
decoded cloud is as dense as the input.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import chain, pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.box_tree import BoxTree, box_tree
from pointkit.geometry.cloud import Floats
from pointkit.threads import in_threads
from primitive_codec import voxel_mode
from primitive_codec.bounded_search import nearest_within
from primitive_codec.cells import centre_distances
from primitive_codec.distortion import Distortion, NearestOffsets
from primitive_codec.stream import CLASSES, MAX_HYBRID_VOXELS, HybridHeader, pack_hybrid
from primitive_codec.voxel_mode import CodedVoxels, LocalPlanes, VoxelSearch

if TYPE_CHECKING:
    from primitive_codec.surface_mode import CodedSurface

_DISTANCE_BOUNDS = np.array([0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0, 1.25, 1.5, 2.0])
"""Class bounds of the distance along the normal, in voxels."""
_MAX_TANGENTIAL_DISTANCE = 1.0
"""Distance within the tangent plane, in voxels, beyond which voxels form separate classes."""
_KEEP_DISTANCES = (0, 6, 7, 8)
"""Candidate keep distances in 1/16 voxels (see `HybridHeader`)."""
_MIN_VOXEL_SHARE = 0.1
"""Fraction of all bytes below which voxels are not worth their header."""

_MAX_SEARCH_STEPS = 1 << 28
"""Largest number of points and boxes that a decoder compares with voxels (one or two seconds)."""


class HybridCriterion(NamedTuple):
    """The functions by which the encoder compares hybrid candidates."""

    nearest_offsets: Callable[[Floats], NearestOffsets]  # from decoded points (k, 3) to the cloud
    measure: Callable[
        [Floats, NearestOffsets], Distortion
    ]  # of decoded points (k, 3) with their offsets
    cost: Callable[[Distortion], float]  # to be minimised


class HybridCandidate(NamedTuple):
    """An encoded hybrid, with its cost and distortion."""

    cost: float
    distortion: Distortion
    stream: bytes


def decode(header: HybridHeader, xyz: Floats, normals: Floats) -> Floats:
    """Return the points (n, 3) of a hybrid stream, in the coordinates of the cloud.

    Parameters
    ----------
    header
        Header of the hybrid stream, which contains the voxel stream.
    xyz, normals
        Points and unit normals (m, 3) of the decoded surface.

    Raises
    ------
    InputError
        If the stream is damaged, or its voxels lie too far from its surface.
    """
    grid, voxels, points = voxel_mode.read_voxels(header.voxels)
    if len(voxels) and len(xyz):
        if not np.isfinite(xyz).all():
            raise InputError("the stream is damaged (points of its surface are not finite)")
        planes = _nearest_planes(points, xyz, normals, box_tree(xyz), grid.cell_size)
        points = planes.displace(points, header.factors, grid.cell_size)
        is_kept = centre_distances(xyz, *grid, voxels) < header.keep_distance / 16
        points = np.concatenate([points, xyz[is_kept]])
    if not len(points) or not np.isfinite(points).all():
        raise InputError("the stream is damaged (it has no points, or some that are not finite)")
    return points


def encode(
    search: VoxelSearch,
    surface: CodedSurface,
    max_bytes: int,
    max_voxel_size: float,
    criterion: HybridCriterion,
) -> HybridCandidate | None:
    """Add the finest voxels to a surface such that both fit into a number of bytes.

    Parameters
    ----------
    search
        Search for the voxel size, which holds the points of the cloud.
    surface
        The encoded surface.
    max_bytes
        Largest total number of bytes.
    max_voxel_size
        Largest side of a voxel, in 1/1023 of the cloud's longest side, even if it takes more bytes.
    criterion
        Functions by which candidates are compared.

    Returns
    -------
    HybridCandidate or None
        None if too few bytes are left for voxels, if there are more than `MAX_HYBRID_VOXELS`, or if
        they lie too far from the surface.
    """
    if not has_voxel_budget(surface.stream, max_bytes):
        return None
    voxels = search.encode_to_budget(max_bytes - len(surface.stream), max_voxel_size)
    if len(voxels.points) > MAX_HYBRID_VOXELS:
        return None
    surface = _without_surplus(surface, voxels, len(search.points))
    with suppress(InputError):  # voxels are too far from the surface
        return _best_candidate(surface, voxels, criterion)
    return None


def _without_surplus(surface: CodedSurface, voxels: CodedVoxels, count: int) -> CodedSurface:
    xyz = surface.decoded().xyz
    distances = centre_distances(xyz, *voxels.grid, voxels.groups.cells)
    kept = int(np.count_nonzero(16 * distances < _KEEP_DISTANCES[-1]))
    most_points = max(count - len(voxels.points), 0)
    return surface.with_points(len(xyz) * most_points // kept) if kept > most_points else surface


def has_voxel_budget(surface: bytes, max_bytes: int) -> bool:
    """Return whether a surface stream leaves enough of `max_bytes` for voxels."""
    return max_bytes - len(surface) >= _MIN_VOXEL_SHARE * max_bytes


def _best_candidate(
    coded_surface: CodedSurface, coded: CodedVoxels, criterion: HybridCriterion
) -> HybridCandidate:
    """Return the hybrid of least cost over keep distances, with and without displacements."""
    grid, groups, surface = coded.grid, coded.groups, coded_surface.decoded()
    tree, weights = box_tree(surface.xyz), voxel_mode.voxel_weights(groups)
    distances = 16 * centre_distances(surface.xyz, *grid, groups.cells)
    # Nearest points are searched only among those that each larger keep distance adds.
    added: dict[int, NearestOffsets] = {}
    for previous, keep_distance in pairwise(_KEEP_DISTANCES):
        is_added = (distances >= previous) & (distances < keep_distance)
        if is_added.any():
            added[keep_distance] = criterion.nearest_offsets(surface.xyz[is_added])

    def candidates(voxels: CodedVoxels) -> Iterator[HybridCandidate]:
        planes = _nearest_planes(voxels.points, surface.xyz, surface.normals, tree, grid.cell_size)
        offsets = (voxels.points - grid.origin) / grid.cell_size - groups.means
        factors, _ = planes.fit_factors(offsets, weights)
        displaced = planes.displace(voxels.points, factors, grid.cell_size)
        nearest = criterion.nearest_offsets(displaced)
        for keep_distance in _KEEP_DISTANCES:
            decoded = np.concatenate([displaced, surface.xyz[distances < keep_distance]])
            nearest = nearest.nearer(added[keep_distance]) if keep_distance in added else nearest
            distortion = criterion.measure(decoded, nearest)
            header = HybridHeader(keep_distance, factors, coded_surface.stream, voxels.stream)
            yield HybridCandidate(criterion.cost(distortion), distortion, pack_hybrid(header))

    variants = [coded, coded.undisplaced()] if coded.displacements else [coded]
    results = in_threads(lambda voxels: list(candidates(voxels)), variants)
    return min(chain.from_iterable(results), key=lambda candidate: candidate.cost)


def _nearest_planes(
    points: Floats, xyz: Floats, normals: Floats, tree: BoxTree, cell_size: float
) -> LocalPlanes:
    """Return for each voxel point the tangent plane at the nearest surface point."""
    # Raises InputError if the search takes too long, as at the centre of a sphere, where all
    # surface points are equally near.
    nearest = nearest_within(points, tree, _MAX_SEARCH_STEPS)
    if nearest is None:
        raise InputError("the stream is damaged, or its voxels lie too far from its surface")
    distances, rows = nearest
    nearest_normals = normals[rows]
    normal_distances = ((points - xyz[rows]) * nearest_normals).sum(axis=1) / cell_size
    squared_tangential = (distances / cell_size) ** 2 - normal_distances**2
    is_beside = squared_tangential > _MAX_TANGENTIAL_DISTANCE**2
    classes = 2 * np.searchsorted(_DISTANCE_BOUNDS, np.abs(normal_distances)) + is_beside
    return LocalPlanes(nearest_normals, normal_distances, classes)


assert 2 * (len(_DISTANCE_BOUNDS) + 1) == CLASSES  # noqa: S101

"""Hybrid mode: a surface, and voxels that say where on it and how far off it the points lie.

A surface leaves out where on it the points are, and their noise; voxels know both, but not the
surface as precisely. Together: each voxel moves along the surface's normal, by a share of its
distance that the stream holds for each class of distances, and the surface keeps those of its own
points that lie in occupied voxels, which makes the decoded cloud as dense as the coded one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.primitives import voxel_mode
from puckbench.codecs.primitives.displacements import LocalPlanes
from puckbench.codecs.primitives.octree_arrays import Ints
from puckbench.codecs.primitives.stream import (
    CLASSES,
    GridPlacement,
    HybridHeader,
    pack_hybrid,
)
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

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


class SurfacePart(NamedTuple):
    """A stream of surfaces, and the points (m, 3) and unit normals that it decodes to."""

    stream: bytes
    xyz: Floats
    normals: Floats


def decode(header: HybridHeader, xyz: Floats, normals: Floats) -> Floats:
    """Points (k, 3) of a hybrid stream, whose surface has points xyz (m, 3) with normals.

    Raises
    ------
    InputError
        If the stream is damaged.
    """
    place, voxels, points = voxel_mode.decoded_voxels(header.voxels)
    if len(voxels) and len(xyz):
        planes = _planes_below(points, _tree(xyz), normals, place.cell_size)
        points = _displaced(points, planes, place.cell_size, header.factors)
        kept = xyz[_off_centre(xyz, place, voxels) < header.reach / 16]
        points = np.concatenate([points, kept])
    if not len(points) or not np.isfinite(points).all():
        raise InputError("the stream is damaged (it has no points, or some that are not finite)")
    return points


def encode(
    points: Floats,
    surface: SurfacePart,
    max_bytes: int,
    max_voxel_size: float,
    cost: Callable[[Floats], float],
) -> tuple[float, bytes] | None:
    """Code a cloud as a surface and the finest voxels that fit beside it.

    Parameters
    ----------
    points
        (n, 3) points.
    surface
        The coded surface.
    max_bytes
        Budget of the whole stream.
    max_voxel_size
        As of `voxel_mode.encode_to_budget`.
    cost
        Distortion of decoded points, by which the kept points of the surface are chosen.

    Returns
    -------
    tuple or None
        Cost and stream of the best choice; None if the surface leaves too few bytes.
    """
    left = max_bytes - len(surface.stream)
    if left < _MIN_VOXEL_SHARE * max_bytes:
        return None
    displaced = voxel_mode.encode_to_budget(points, left, max_voxel_size)
    tree = _tree(surface.xyz)
    best: tuple[float, bytes] | None = None
    with suppress(InputError):  # of more voxels than a hybrid may have
        for voxels in dict.fromkeys([displaced, voxel_mode.without_displacements(displaced)]):
            for header, decoded in _choices(points, surface, tree, voxels):
                found = cost(decoded) if len(decoded) <= _MAX_POINTS * len(points) else np.inf
                if best is None or found < best[0]:
                    best = found, pack_hybrid(header)
    return best


def _choices(
    points: Floats, surface: SurfacePart, tree: Any, voxel_stream: bytes
) -> Iterator[tuple[HybridHeader, Floats]]:
    """Hybrids of a surface and voxels, by reach, and what each decodes to."""
    place, voxels, placed = voxel_mode.decoded_voxels(voxel_stream)
    planes = _planes_below(placed, tree, surface.normals, place.cell_size)
    factors = _fitted_factors(points, planes, place, voxels, placed)
    moved = _displaced(placed, planes, place.cell_size, factors)
    off_centre = _off_centre(surface.xyz, place, voxels)
    for reach in _REACHES:
        header = HybridHeader(reach, factors, surface.stream, voxel_stream)
        yield header, np.concatenate([moved, surface.xyz[off_centre < reach / 16]])


def _fitted_factors(
    points: Floats, planes: LocalPlanes, place: GridPlacement, voxels: Ints, placed: Floats
) -> NDArray[np.int8]:
    """Shares of least squared error between moved voxels and the means of their points."""
    voxelised = voxel_mode.voxelise((points - place.origin) / place.cell_size)
    low = voxels.min(axis=0)
    rows = np.empty(len(voxels), np.int64)
    rows[np.argsort(_keys(voxels - low))] = np.argsort(_keys(voxelised.voxels - low))
    means, counts = voxelised.means[rows], voxelised.counts[rows]
    weights = counts / counts.sum() + 1 / len(counts)
    return planes.fitted((placed - place.origin) / place.cell_size - means, weights)[0]


def _displaced(
    points: Floats, planes: LocalPlanes, cell_size: float, factors: NDArray[np.int8]
) -> Floats:
    """Points (m, 3) moved along the normals of a surface, by the shares of their classes."""
    shift = planes.shifts(factors) * cell_size
    return np.asarray(points - shift[:, None] * planes.normals)


def _tree(xyz: Floats) -> Any:
    """A search tree of a surface's points (m, 3)."""
    from scipy.spatial import cKDTree

    return cKDTree(xyz, balanced_tree=False, compact_nodes=False)


def _planes_below(points: Floats, tree: Any, normals: Floats, cell_size: float) -> LocalPlanes:
    """The surface at its nearest point to each of some points (m, 3); distances in voxels."""
    distance, row = tree.query(points)
    along = normals[row]
    offset = np.einsum("ij,ij->i", points - tree.data[row], along) / cell_size
    across = (distance / cell_size) ** 2 - offset**2
    classes = 2 * np.searchsorted(_DISTANCES, np.abs(offset)) + (across > _BESIDE**2)
    return LocalPlanes(along, offset, classes)


def _off_centre(xyz: Floats, place: GridPlacement, voxels: Ints) -> Floats:
    """Distance along an axis, at most, of points (m, 3) from the centre of their voxel, (m,).

    In voxels; infinite where no voxel is occupied.
    """
    cells = (xyz - place.origin) / place.cell_size
    low, high = voxels.min(axis=0), voxels.max(axis=0)
    inside = ((cells > low - 0.5) & (cells < high + 0.5)).all(axis=1)
    nearest = np.rint(cells[inside])
    occupied = np.isin(_keys(nearest.astype(np.int64) - low), _keys(voxels - low))
    found = np.full(len(xyz), np.inf)
    found[inside] = np.where(occupied, np.abs(cells[inside] - nearest).max(axis=1), np.inf)
    return found


def _keys(cells: Ints) -> Ints:
    """One integer for each cell (n, 3), of coordinates from 0 to 2^21."""
    return (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]


assert 2 * (len(_DISTANCES) + 1) == CLASSES  # noqa: S101

"""Voxel mode: voxels of G-PCC's octree, displaced along normals, for clouds without surfaces."""

from __future__ import annotations

from math import log
from typing import NamedTuple

import numpy as np

from puckbench.codecs.gpcc.lossless import decode_voxels, encode_voxels
from puckbench.codecs.primitives.cells import CellGroups, group_by_cell
from puckbench.codecs.primitives.displacements import displace, fit_displacements
from puckbench.codecs.primitives.octree_arrays import Ints
from puckbench.codecs.primitives.settings import UNITS
from puckbench.codecs.primitives.stream import (
    CLASSES,
    MAX_DISPLACED,
    MAX_HYBRID_VOXELS,
    VOXEL_HEADER_BYTES,
    DisplacementTable,
    GridPlacement,
    VoxelHeader,
    pack_voxels,
    unpack,
)
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats, bounds

_FINEST = UNITS / (1 << 20)
_MAX_TRIALS = 6
_BUDGET_SLACK = 0.04
"""Share of the byte budget that the search may leave unused."""
_MIN_ERROR_PER_BYTE = 0.5
"""Share of the squared error that a table must save for each share of the bytes that it takes."""
_TYPICAL_SLOPE = 2.2

Trials = list[tuple[float, int]]
"""Sides of voxels that were tried, and the bytes that they took."""


class _Coded(NamedTuple):
    """Coded voxels: their grid, the voxels, G-PCC's octree."""

    place: GridPlacement
    voxels: CellGroups
    bits: bytes

    def size(self) -> int:
        """Length of the stream, if it has displacements."""
        return VOXEL_HEADER_BYTES + CLASSES + len(self.bits)

    def stream(self) -> bytes:
        """The stream, with the best displacements where these are worth their bytes."""
        return pack_voxels(self.place, _displacements(self.voxels, len(self.bits)), self.bits)


def voxelise(points: Floats, place: GridPlacement) -> CellGroups:
    """Voxels that points (n, 3) are rounded to."""
    return group_by_cell(points, place.cell_size, place.origin, centred=True)


def encode_voxel_size(points: Floats, size: float) -> bytes:
    """A stream of the voxels of side `size` that points (n, 3) lie in."""
    return _coded(points, size).stream()


def bytes_of_voxel_size(points: Floats, size: float, tried: Trials) -> int:
    """Length of the stream that `encode_voxel_size` makes, at most; it joins what was tried."""
    found = _coded(points, size).size()
    tried.append((size, found))
    return found


def _coded(points: Floats, size: float) -> _Coded:
    place = GridPlacement(bounds(points)[0], size).rounded()
    voxels = voxelise(points, place)
    return _Coded(place, voxels, encode_voxels(voxels.cells))


def encode_to_budget(
    points: Floats,
    max_bytes: int,
    max_voxel_size: float = UNITS / 4,
    tried: Trials | None = None,
) -> bytes:
    """Code the finest voxels that take no more than about `max_bytes` bytes.

    Parameters
    ----------
    points
        (n, 3) points.
    max_bytes
        The budget.
    max_voxel_size
        Bound of the voxels' side in units of 1/1023 of the extent, even if they take more bytes.
    tried
        Sides of voxels of these points that were tried for other budgets; those tried now join
        them.
    """
    low, high = bounds(points)
    extent = float((high - low).max())
    if extent == 0:
        return encode_voxel_size(points, 1.0)
    max_bytes, tried = max(max_bytes, 1), [] if tried is None else tried
    finest, coarsest = extent / UNITS * _FINEST, extent / UNITS * max_voxel_size
    best: _Coded | None = None
    sizes: set[float] = set()
    size = _next_size(tried, max_bytes) if tried else _initial_size(points, extent, max_bytes)
    while len(sizes) < _MAX_TRIALS and (size := min(max(size, finest), coarsest)) not in sizes:
        coded = _coded(points, size)
        found = coded.size()
        if found <= max_bytes and (best is None or found > best.size()):
            best = coded
        sizes.add(size)
        tried.append((size, found))
        if max_bytes * (1 - _BUDGET_SLACK) <= found <= max_bytes:
            break
        size = _next_size(tried, max_bytes)
    return (best or coded).stream()


def _next_size(tried: Trials, max_bytes: int) -> float:
    """The side that is expected to take almost all of a budget.

    It lies between the trials next above and below the budget, or beyond the two nearest ones.
    """
    wanted = max_bytes * (1 - _BUDGET_SLACK / 2)
    nearest = sorted(tried, key=lambda trial: abs(log(trial[1] / wanted)))
    (size, found), others = nearest[0], nearest[1:]
    beyond = [trial for trial in others if (trial[1] > wanted) != (found > wanted)]
    partner = next(iter(beyond or others), None)
    slope = _slope(nearest[0], partner) if partner else _TYPICAL_SLOPE
    return float(size * (found / wanted) ** (1 / slope))


def decode(place: GridPlacement, table: DisplacementTable | None, bits: bytes) -> Floats:
    """Points (m, 3) of voxels; InputError for a damaged stream."""
    voxels = decode_voxels(bits) if table is None else decode_voxels(bits, MAX_DISPLACED)
    return _placed(place, table, voxels)


class DecodedVoxels(NamedTuple):
    """Grid and voxels (m, 3) of a stream, and the points (m, 3) that they are displaced to.

    undisplaced: the same as a stream of voxels that stay in their centres; None where they do.
    """

    place: GridPlacement
    voxels: Ints
    points: Floats
    undisplaced: tuple[bytes, Floats] | None


def decoded_voxels(stream: bytes, most: int | None = None) -> DecodedVoxels:
    """Voxels of a stream, `MAX_HYBRID_VOXELS` unless more are allowed.

    Raises
    ------
    InputError
        If the stream is damaged, or of another kind, or has more voxels.
    """
    place, table, bits = _unpacked(stream)
    voxels = decode_voxels(bits, MAX_HYBRID_VOXELS if most is None else most)
    points = _placed(place, table, voxels)
    if table is None:
        return DecodedVoxels(place, voxels, points, None)
    undisplaced = pack_voxels(place, None, bits), _placed(place, None, voxels)
    return DecodedVoxels(place, voxels, points, undisplaced)


def _unpacked(stream: bytes) -> tuple[GridPlacement, DisplacementTable | None, bytes]:
    header, bits = unpack(stream)
    if not isinstance(header, VoxelHeader):
        raise InputError("the stream holds no voxels")
    return header.place, header.table, bits


def _placed(place: GridPlacement, table: DisplacementTable | None, voxels: Ints) -> Floats:
    """Points (m, 3) of decoded voxels (m, 3), displaced by the table."""
    xyz = displace(voxels, table) if table is not None and len(voxels) else voxels
    return np.asarray(xyz * place.cell_size + place.origin)


def targets(voxels: CellGroups) -> tuple[Ints, Floats, Floats]:
    """Voxels (m, 3), the means (m, 3) of their points, and the weights (m,) of their errors."""
    weights = voxels.counts / voxels.counts.sum() + 1 / len(voxels.counts)
    return voxels.cells, voxels.means, weights


def _displacements(voxels: CellGroups, voxel_bytes: int) -> DisplacementTable | None:
    """The best table; None where it saves less of the squared error than it adds to the bytes."""
    if len(voxels.cells) > MAX_DISPLACED:
        return None
    cells, means, weights = targets(voxels)
    error = (weights[:, None] * (cells - means) ** 2).sum()
    table, gain = fit_displacements(cells, means, weights)
    return table if gain > _MIN_ERROR_PER_BYTE * CLASSES / voxel_bytes * error else None


def _initial_size(points: Floats, extent: float, max_bytes: int) -> float:
    """A side to begin with, at two bits for each of the voxels of a surface."""
    wanted = max(4.0 * max_bytes, 8.0)
    size = extent / 64
    count = len(group_by_cell(points, size, centred=True).cells)
    return float(size * max(count / wanted, 1e-6) ** 0.5)


def _slope(a: tuple[float, int], b: tuple[float, int]) -> float:
    """Exponent with which bytes fall as voxels grow, from two trials (side, bytes)."""
    if a[0] == b[0] or a[1] == b[1]:
        return _TYPICAL_SLOPE
    return float(min(max(log(a[1] / b[1]) / log(b[0] / a[0]), 0.5), 3.5))

"""Voxel mode: voxels of G-PCC's octree, displaced along normals, for clouds without surfaces."""

from __future__ import annotations

from collections.abc import Iterable
from math import log
from typing import NamedTuple

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats, bounds
from puckbench.gpcc.lossless import decode_voxels, encode_voxels
from puckbench.primitives.cells import CellGroups, group_by_cell
from puckbench.primitives.displacements import FittedTable, displace, fit_displacements
from puckbench.primitives.octree_arrays import Ints
from puckbench.primitives.settings import UNITS
from puckbench.primitives.stream import (
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

_FINEST = UNITS / (1 << 20)
_MAX_TRIALS = 6
_BUDGET_SLACK = 0.04
"""Share of the byte budget that the search may leave unused."""
_MIN_ERROR_PER_BYTE = 0.5
"""Share of the squared error that a table must save for each share of the bytes that it takes."""
_TYPICAL_SLOPE = 2.2

Trial = tuple[float, int]
"""A side of voxels, and the bytes that they took."""


class CodedVoxels(NamedTuple):
    """Voxels of a cloud as they are coded.

    place: their grid. groups: the cloud's points by voxels. table: displacements, or None. points:
    (m, 3) what the stream decodes to, in the order of the groups. bits: G-PCC's octree.
    """

    place: GridPlacement
    groups: CellGroups
    table: DisplacementTable | None
    points: Floats
    bits: bytes

    @property
    def stream(self) -> bytes:
        """The stream."""
        return pack_voxels(self.place, self.table, self.bits)

    def undisplaced(self) -> CodedVoxels:
        """The same voxels, which stay in their centres."""
        return self._replace(table=None, points=_in_space(self.groups.cells, self.place))


class _Octree(NamedTuple):
    """Coded voxels before their displacements are known: grid, voxels, G-PCC's octree."""

    place: GridPlacement
    groups: CellGroups
    bits: bytes

    @classmethod
    def of(cls, points: Floats, side: float) -> _Octree:
        """The voxels of a side that points (n, 3) lie in."""
        place = GridPlacement(bounds(points)[0], side).rounded()
        groups = voxelise(points, place)
        return cls(place, groups, encode_voxels(groups.cells))

    def size(self) -> int:
        """Length of the stream, if it has displacements."""
        return VOXEL_HEADER_BYTES + CLASSES + len(self.bits)

    def displaced(self) -> CodedVoxels:
        """With the best displacements, where these are worth their bytes."""
        found = _displacements(self.groups, len(self.bits))
        table, xyz = (found.table, found.displaced) if found else (None, self.groups.cells)
        return CodedVoxels(self.place, self.groups, table, _in_space(xyz, self.place), self.bits)


def voxelise(points: Floats, place: GridPlacement) -> CellGroups:
    """Voxels that points (n, 3) are rounded to."""
    return group_by_cell(points, place.cell_size, place.origin, centred=True)


def encode_voxel_size(points: Floats, size: float) -> bytes:
    """A stream of the voxels of side `size` that points (n, 3) lie in."""
    return _Octree.of(points, size).displaced().stream


class VoxelSearch:
    """Finds voxels of a cloud for budgets; what was tried for one helps to find the next ones'.

    Attributes
    ----------
    points
        (n, 3) points.
    tried
        Sides of voxels that were tried, and the bytes that they took.
    """

    def __init__(self, points: Floats, tried: Iterable[Trial] = ()) -> None:
        self.points, self.tried = points, list(tried)
        self._coded: dict[float, CodedVoxels] = {}

    def bytes_of(self, size: float) -> int:
        """Length of the stream of voxels of a side, at most."""
        found = _Octree.of(self.points, size).size()
        self.tried.append((size, found))
        return found

    def to_budget(self, max_bytes: int, max_voxel_size: float = UNITS / 4) -> CodedVoxels:
        """Code the finest voxels that take no more than about `max_bytes` bytes.

        Parameters
        ----------
        max_bytes
            The budget.
        max_voxel_size
            Bound of the voxels' side in units of 1/1023 of the extent, even if they take more
            bytes.
        """
        low, high = bounds(self.points)
        extent = float((high - low).max())
        if extent == 0:
            return _Octree.of(self.points, 1.0).displaced()
        max_bytes = max(max_bytes, 1)
        finest, coarsest = extent / UNITS * _FINEST, extent / UNITS * max_voxel_size
        size = _within(self._first_size(max_bytes, extent), finest, coarsest)
        if size in self._coded:
            return self._coded[size]
        best: _Octree | None = None
        sizes: set[float] = set()
        while len(sizes) < _MAX_TRIALS and size not in sizes:
            octree = _Octree.of(self.points, size)
            found = octree.size()
            if found <= max_bytes and (best is None or found > best.size()):
                best = octree
            sizes.add(size)
            self.tried.append((size, found))
            if _fills(found, max_bytes):
                break
            size = _within(_next_size(self.tried, max_bytes), finest, coarsest)
        chosen = (best or octree).displaced()
        self._coded[chosen.place.cell_size] = chosen
        return chosen

    def _first_size(self, max_bytes: int, extent: float) -> float:
        """A side that was found to fill a budget, or one that is expected to."""
        filling = [trial for trial in self.tried if _fills(trial[1], max_bytes)]
        if filling:
            return max(filling, key=lambda trial: trial[1])[0]
        if self.tried:
            return _next_size(self.tried, max_bytes)
        return _initial_size(self.points, extent, max_bytes)


def _within(size: float, finest: float, coarsest: float) -> float:
    """The side within bounds, in single precision, as a stream holds it."""
    return float(np.float32(min(max(size, finest), coarsest)))


def _fills(found: int, max_bytes: int) -> bool:
    return max_bytes * (1 - _BUDGET_SLACK) <= found <= max_bytes


def _next_size(tried: list[Trial], max_bytes: int) -> float:
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
    """Grid and voxels (m, 3) of a stream, and the points (m, 3) that they are displaced to."""

    place: GridPlacement
    voxels: Ints
    points: Floats


def decoded_voxels(stream: bytes) -> DecodedVoxels:
    """Voxels of a stream.

    Raises
    ------
    InputError
        If the stream is damaged, or of another kind, or has more than `MAX_HYBRID_VOXELS`.
    """
    header, bits = unpack(stream)
    if not isinstance(header, VoxelHeader):
        raise InputError("the stream holds no voxels")
    voxels = decode_voxels(bits, MAX_HYBRID_VOXELS)
    return DecodedVoxels(header.place, voxels, _placed(header.place, header.table, voxels))


def _placed(place: GridPlacement, table: DisplacementTable | None, voxels: Ints) -> Floats:
    """Points (m, 3) of decoded voxels (m, 3), displaced by the table."""
    return _in_space(displace(voxels, table) if table and len(voxels) else voxels, place)


def _in_space(xyz: Floats | Ints, place: GridPlacement) -> Floats:
    """Points (m, 3), in voxels of a grid, in the cloud's coordinates."""
    return np.asarray(xyz * place.cell_size + place.origin)


def weights_of(groups: CellGroups) -> Floats:
    """Weights (m,) of the errors of voxels."""
    return np.asarray(groups.counts / groups.counts.sum() + 1 / len(groups.counts))


def _displacements(groups: CellGroups, voxel_bytes: int) -> FittedTable | None:
    """The best table; None where it saves less of the squared error than it adds to the bytes."""
    if len(groups.cells) > MAX_DISPLACED:
        return None
    weights = weights_of(groups)
    error = (weights[:, None] * (groups.cells - groups.means) ** 2).sum()
    found = fit_displacements(groups.cells, groups.means, weights)
    return found if found.gain > _MIN_ERROR_PER_BYTE * CLASSES / voxel_bytes * error else None


def _initial_size(points: Floats, extent: float, max_bytes: int) -> float:
    """A side to begin with, at two bits for each of the voxels of a surface."""
    wanted = max(4.0 * max_bytes, 8.0)
    size = extent / 64
    count = len(group_by_cell(points, size, centred=True).cells)
    return float(size * max(count / wanted, 1e-6) ** 0.5)


def _slope(a: Trial, b: Trial) -> float:
    """Exponent with which bytes fall as voxels grow, from two trials (side, bytes)."""
    if a[0] == b[0] or a[1] == b[1]:
        return _TYPICAL_SLOPE
    return float(min(max(log(a[1] / b[1]) / log(b[0] / a[0]), 0.5), 3.5))

"""Voxel mode: voxels of a G-PCC octree, displaced along normals, for clouds without surfaces."""

from __future__ import annotations

from collections.abc import Iterable
from math import log
from typing import NamedTuple

import numpy as np

from gpcc.lossless import decode_voxels, encode_voxels
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, bounds
from primitive_codec.cells import CellGroups, group_by_cell
from primitive_codec.displacements import displace, fit_displacements
from primitive_codec.octree_arrays import Ints
from primitive_codec.settings import UNITS
from primitive_codec.stream import (
    CLASSES,
    MAX_DISPLACED,
    MAX_HYBRID_VOXELS,
    VOXEL_HEADER_BYTES,
    DisplacementTable,
    VoxelGrid,
    VoxelHeader,
    pack_voxels,
    unpack,
)

_MIN_VOXEL_SIZE = UNITS / (1 << 20)
_MAX_TRIALS_PER_BUDGET = 6
_BUDGET_SLACK = 0.04
"""Fraction of the byte budget that the search may leave unused."""
_MIN_ERROR_PER_BYTE = 0.5
"""Least relative reduction of the squared error by displacement, per relative increase in bytes."""
_TYPICAL_SLOPE = 2.2
"""Typical exponent b of the relation bytes ~ voxel size ** -b."""


class Trial(NamedTuple):
    voxel_size: float
    byte_count: int  # length of the stream


class CodedVoxels(NamedTuple):
    grid: VoxelGrid
    groups: CellGroups  # the cloud's points by voxel
    payload: bytes  # G-PCC octree
    points: Floats  # (m, 3) decoded, in the order of the groups
    displacements: DisplacementTable | None = None

    @classmethod
    def of(cls, points: Floats, voxel_size: float) -> CodedVoxels:
        """Encode points as voxels without displacements."""
        grid = VoxelGrid(bounds(points)[0], voxel_size).rounded()
        groups = voxelise(points, grid)
        return cls(grid, groups, encode_voxels(groups.cells), _to_cloud(groups.cells, grid))

    @property
    def stream(self) -> bytes:
        return pack_voxels(self.grid, self.displacements, self.payload)

    def most_bytes(self) -> int:
        """Return the length of the stream with displacements."""
        return VOXEL_HEADER_BYTES + CLASSES + len(self.payload)

    def displaced(self) -> CodedVoxels:
        """Return the voxels with displacements, if these reduce the error enough for their cost."""
        groups = self.groups
        if len(groups.cells) > MAX_DISPLACED:
            return self
        weights = voxel_weights(groups)
        error = (weights[:, None] * (groups.cells - groups.means) ** 2).sum()
        fitted = fit_displacements(groups.cells, groups.means, weights)
        if fitted.gain <= _MIN_ERROR_PER_BYTE * CLASSES / len(self.payload) * error:
            return self
        points = _to_cloud(fitted.displaced, self.grid)
        return self._replace(points=points, displacements=fitted.table)

    def undisplaced(self) -> CodedVoxels:
        return self._replace(displacements=None, points=_to_cloud(self.groups.cells, self.grid))


def voxelise(points: Floats, grid: VoxelGrid) -> CellGroups:
    return group_by_cell(points, grid.cell_size, grid.origin, centred=True)


def encode_voxels_of_size(points: Floats, voxel_size: float) -> bytes:
    return CodedVoxels.of(points, voxel_size).displaced().stream


class VoxelSearch:
    """Search for the voxel size that fits a byte budget, starting from earlier trials."""

    def __init__(self, points: Floats, trials: Iterable[Trial] = ()) -> None:
        self.points, self.trials = points, list(trials)
        self._coded: dict[float, CodedVoxels] = {}

    def byte_count_at(self, voxel_size: float) -> int:
        """Return the largest byte count of a stream with this voxel size."""
        trial = Trial(voxel_size, CodedVoxels.of(self.points, voxel_size).most_bytes())
        self.trials.append(trial)
        return trial.byte_count

    def encode_to_budget(self, max_bytes: int, max_voxel_size: float = UNITS / 4) -> CodedVoxels:
        """Encode the finest voxels that take at most about `max_bytes` bytes.

        `max_voxel_size`, in 1/1023 of the extent, bounds the voxels' side for any budget.
        """
        low, high = bounds(self.points)
        extent = float((high - low).max())
        if extent == 0:
            return CodedVoxels.of(self.points, 1.0).displaced()
        max_bytes = max(max_bytes, 1)
        smallest, largest = extent / UNITS * _MIN_VOXEL_SIZE, extent / UNITS * max_voxel_size
        voxel_size = _clamp(self._first_voxel_size(max_bytes, extent), smallest, largest)
        if voxel_size in self._coded:
            return self._coded[voxel_size]
        best: CodedVoxels | None = None
        sizes: set[float] = set()
        while len(sizes) < _MAX_TRIALS_PER_BUDGET and voxel_size not in sizes:
            voxels = CodedVoxels.of(self.points, voxel_size)
            byte_count = voxels.most_bytes()
            if byte_count <= max_bytes and (best is None or byte_count > best.most_bytes()):
                best = voxels
            sizes.add(voxel_size)
            self.trials.append(Trial(voxel_size, byte_count))
            if _fills(byte_count, max_bytes):
                break
            voxel_size = _clamp(_next_voxel_size(self.trials, max_bytes), smallest, largest)
        coded = (best or voxels).displaced()
        self._coded[coded.grid.cell_size] = coded
        return coded

    def _first_voxel_size(self, max_bytes: int, extent: float) -> float:
        filling = [trial for trial in self.trials if _fills(trial.byte_count, max_bytes)]
        if filling:
            return max(filling, key=lambda trial: trial.byte_count).voxel_size
        if self.trials:
            return _next_voxel_size(self.trials, max_bytes)
        return _initial_voxel_size(self.points, extent, max_bytes)


def _clamp(voxel_size: float, smallest: float, largest: float) -> float:
    return float(np.float32(min(max(voxel_size, smallest), largest)))


def _fills(byte_count: int, max_bytes: int) -> bool:
    return max_bytes * (1 - _BUDGET_SLACK) <= byte_count <= max_bytes


def _next_voxel_size(trials: list[Trial], max_bytes: int) -> float:
    target = max_bytes * (1 - _BUDGET_SLACK / 2)
    nearest, *others = sorted(trials, key=lambda trial: abs(log(trial.byte_count / target)))
    exceeds = nearest.byte_count > target
    opposite = [trial for trial in others if (trial.byte_count > target) != exceeds]
    partner = next(iter(opposite or others), None)
    slope = _slope(nearest, partner) if partner else _TYPICAL_SLOPE
    return float(nearest.voxel_size * (nearest.byte_count / target) ** (1 / slope))


def decode(header: VoxelHeader, payload: bytes) -> Floats:
    is_displaced = header.displacements is not None
    voxels = decode_voxels(payload, MAX_DISPLACED) if is_displaced else decode_voxels(payload)
    return _reconstruct(header, voxels)


class DecodedVoxels(NamedTuple):
    grid: VoxelGrid
    voxels: Ints  # (m, 3)
    points: Floats  # (m, 3) displaced, in the cloud's coordinates


def read_voxels(stream: bytes) -> DecodedVoxels:
    """Decode a voxel stream; raise InputError if of another kind or over `MAX_HYBRID_VOXELS`."""
    header, payload = unpack(stream)
    if not isinstance(header, VoxelHeader):
        raise InputError("the stream holds no voxels")
    voxels = decode_voxels(payload, MAX_HYBRID_VOXELS)
    return DecodedVoxels(header.grid, voxels, _reconstruct(header, voxels))


def _reconstruct(header: VoxelHeader, voxels: Ints) -> Floats:
    if header.displacements and len(voxels):
        return _to_cloud(displace(voxels, header.displacements), header.grid)
    return _to_cloud(voxels, header.grid)


def _to_cloud(xyz: Floats | Ints, grid: VoxelGrid) -> Floats:
    return np.asarray(xyz * grid.cell_size + grid.origin)


def voxel_weights(groups: CellGroups) -> Floats:
    """Return voxel weights (m,): half in proportion to numbers of points, half equal."""
    return np.asarray(groups.counts / groups.counts.sum() + 1 / len(groups.counts))


def _initial_voxel_size(points: Floats, extent: float, max_bytes: int) -> float:
    target = max(4.0 * max_bytes, 8.0)
    voxel_size = extent / 64
    count = len(group_by_cell(points, voxel_size, centred=True).cells)
    return float(voxel_size * max(count / target, 1e-6) ** 0.5)


def _slope(a: Trial, b: Trial) -> float:
    if a.voxel_size == b.voxel_size or a.byte_count == b.byte_count:
        return _TYPICAL_SLOPE
    slope = log(a.byte_count / b.byte_count) / log(b.voxel_size / a.voxel_size)
    return float(min(max(slope, 0.5), 3.5))

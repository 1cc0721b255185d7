"""Voxel mode: codes clouds without surfaces as voxels of a G-PCC octree, displaced along normals.

The decoder fits a local plane to the voxels around each voxel. Most points of a voxel lie on the
same side of its centre as this plane. Therefore the decoder moves the centre towards the plane by a
fraction of their distance. Voxels are divided into classes by this distance and by the thickness of
the surface; the encoder sends for each class the fraction that minimises the squared error.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpcc.lossless import decode_voxels, encode_voxels
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, bounds
from pointkit.geometry.tangent_planes import fit_tangent_planes
from primitive_codec.cells import CellGroups, group_by_cell
from primitive_codec.octree_arrays import Ints
from primitive_codec.settings import UNITS
from primitive_codec.stream import (
    BLOCK_SIZES,
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
"""Fraction of the allowed bytes that the search may leave unused."""
_MIN_ERROR_PER_BYTE = 0.5
"""Least relative reduction of the squared error by displacement, per relative increase in bytes."""
_TYPICAL_SLOPE = 2.2
"""Typical exponent b of the relation bytes ~ voxel size ** -b."""
_DISTANCE_BOUNDS = np.array([0.25, 0.5, 0.75, 1.0, 1.5])
"""Class bounds of the distance from the plane, in voxels."""
_THICKNESS_BOUNDS = np.array([0.3, 0.5, 0.9])
"""Class bounds of the surface thickness, in voxels."""
FACTOR_ONE = 64
"""Factor that moves a voxel onto its local plane."""


class Trial(NamedTuple):
    """A voxel size that was tried, with the number of bytes that it took."""

    voxel_size: float
    byte_count: int  # length of the stream


class CodedVoxels(NamedTuple):
    """A cloud that was encoded as voxels, with the points that a decoder will return."""

    grid: VoxelGrid
    groups: CellGroups  # the cloud's points by voxel
    payload: bytes  # G-PCC octree
    points: Floats  # (m, 3) decoded, in the order of the groups
    displacements: DisplacementTable | None = None

    @classmethod
    def of(cls, points: Floats, voxel_size: float) -> CodedVoxels:
        """Encode points (n, 3) as voxels without displacements."""
        grid = VoxelGrid(bounds(points)[0], voxel_size).rounded()
        groups = voxelise(points, grid)
        return cls(grid, groups, encode_voxels(groups.cells), _to_cloud(groups.cells, grid))

    @property
    def stream(self) -> bytes:
        """The complete voxel stream."""
        return pack_voxels(self.grid, self.displacements, self.payload)

    def most_bytes(self) -> int:
        """Return the length that the stream has with displacements, in bytes."""
        return VOXEL_HEADER_BYTES + CLASSES + len(self.payload)

    def displaced(self) -> CodedVoxels:
        """Return the voxels with displacements, or unchanged if these gain too little."""
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
        """Return the voxels without displacements, so that decoded points are voxel centres."""
        return self._replace(displacements=None, points=_to_cloud(self.groups.cells, self.grid))


def voxelise(points: Floats, grid: VoxelGrid) -> CellGroups:
    """Group points (n, 3) by the voxels of a grid."""
    return group_by_cell(points, grid.cell_size, grid.origin, centred=True)


def encode_voxels_of_size(points: Floats, voxel_size: float) -> bytes:
    """Return the voxel stream of points (n, 3) for a voxel size in the unit of the points."""
    return CodedVoxels.of(points, voxel_size).displaced().stream


class VoxelSearch:
    """Finds the voxel size with which a cloud takes a given number of bytes.

    Parameters
    ----------
    points
        Coordinates (n, 3).
    trials
        Voxel sizes whose bytes are already known; they make the search shorter.
    """

    def __init__(self, points: Floats, trials: Iterable[Trial] = ()) -> None:
        self.points, self.trials = points, list(trials)
        self._coded: dict[float, CodedVoxels] = {}

    def byte_count_at(self, voxel_size: float) -> int:
        """Return the most bytes that a stream with this voxel size takes.

        The voxel size is in the unit of the points.
        """
        trial = Trial(voxel_size, CodedVoxels.of(self.points, voxel_size).most_bytes())
        self.trials.append(trial)
        return trial.byte_count

    def encode_to_budget(self, max_bytes: int, max_voxel_size: float = UNITS / 4) -> CodedVoxels:
        """Encode a cloud with the finest voxels that take at most about `max_bytes` bytes.

        Parameters
        ----------
        max_bytes
            Largest length of the stream.
        max_voxel_size
            Largest side of a voxel, in 1/1023 of the cloud's longest side. It takes precedence over
            `max_bytes`.

        Returns
        -------
        CodedVoxels
            The encoded voxels, with displacements if these are worth their bytes.
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
    """Return the points (m, 3) of a voxel stream, in the coordinates of the cloud."""
    is_displaced = header.displacements is not None
    voxels = decode_voxels(payload, MAX_DISPLACED) if is_displaced else decode_voxels(payload)
    return _reconstruct(header, voxels)


class DecodedVoxels(NamedTuple):
    """The voxels of a decoded stream, with one point for each voxel."""

    grid: VoxelGrid
    voxels: Ints  # (m, 3)
    points: Floats  # (m, 3) displaced, in the cloud's coordinates


def read_voxels(stream: bytes) -> DecodedVoxels:
    """Decode a voxel stream that is part of a hybrid.

    Raises
    ------
    InputError
        If the stream is damaged or of another kind, or has more than `MAX_HYBRID_VOXELS` voxels.
    """
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
    """Return the weights (m,) of voxels in the squared error.

    One half of the total weight is proportional to the numbers of points; the other is equal for
    all voxels.
    """
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


class LocalPlanes(NamedTuple):
    """The plane near each voxel, towards which the voxel's centre is moved.

    Attributes
    ----------
    normals
        Unit normals (m, 3).
    distances
        Signed distances (m,) from the planes to the voxels' centres, in voxels.
    classes
        Class (m,) of each voxel, which selects its displacement factor.
    """

    normals: Floats
    distances: Floats
    classes: Ints

    def displace(
        self, points: Floats | Ints, factors: NDArray[np.int8], side: float = 1.0
    ) -> Floats:
        """Move points towards their planes.

        Parameters
        ----------
        points
            Points (m, 3), one for each plane.
        factors
            Displacement factor of each class; `FACTOR_ONE` moves a voxel's centre onto its plane.
        side
            Side of a voxel, in the unit of the points.

        Returns
        -------
        ndarray
            The moved points (m, 3).
        """
        displacement = factors[self.classes] / FACTOR_ONE * self.distances * side
        return np.asarray(points - displacement[:, None] * self.normals)

    def fit_factors(self, offsets: Floats, weights: Floats) -> tuple[NDArray[np.int8], float]:
        """Return the displacement factors that minimise the squared error.

        Parameters
        ----------
        offsets
            For each voxel (m, 3), its centre minus the mean of its points, in voxels.
        weights
            Weights (m,) of the voxels.

        Returns
        -------
        factors
            Factor of each class, int8 (CLASSES,).
        gain
            By how much the factors reduce the weighted sum of squared errors.
        """
        residuals = (offsets * self.normals).sum(axis=1)
        products = np.bincount(self.classes, weights * residuals * self.distances, CLASSES)
        squares = np.bincount(self.classes, weights * self.distances**2, CLASSES)
        factors = np.rint(FACTOR_ONE * products / np.maximum(squares, 1e-12)).clip(-127, 127)
        shares = factors / FACTOR_ONE
        gain = float((2 * shares * products - shares**2 * squares).sum())
        return factors.astype(np.int8), gain


def displace(voxels: Ints, table: DisplacementTable) -> Floats:
    """Return the displaced centres (m, 3) of voxels (m, 3), both in voxels."""
    return _local_planes(voxels, table.block_size).displace(voxels, table.factors)


class FittedTable(NamedTuple):
    """A displacement table that was fitted to a cloud, and what it achieves.

    Attributes
    ----------
    table
        Block size and displacement factors.
    gain
        By how much the table reduces the weighted sum of squared errors.
    displaced
        The moved centres (m, 3) of the voxels, in voxels.
    """

    table: DisplacementTable
    gain: float
    displaced: Floats


def fit_displacements(voxels: Ints, means: Floats, weights: Floats) -> FittedTable:
    """Find the block size and the displacement factors with the least squared error.

    Parameters
    ----------
    voxels
        Voxels (m, 3), as integer coordinates.
    means
        Mean (m, 3) of the points of each voxel, in voxels.
    weights
        Weights (m,) of the voxels.
    """
    offsets = voxels - means

    def fit(block_size: int) -> tuple[float, DisplacementTable, LocalPlanes]:
        planes = _local_planes(voxels, block_size)
        factors, gain = planes.fit_factors(offsets, weights)
        return gain, DisplacementTable(block_size, factors), planes

    gain, table, planes = max(map(fit, BLOCK_SIZES), key=lambda fitted: fitted[0])
    return FittedTable(table, gain, planes.displace(voxels, table.factors))


def _local_planes(voxels: Ints, block_size: int) -> LocalPlanes:
    planes = fit_tangent_planes(voxels, block_size)
    distance_class = np.searchsorted(_DISTANCE_BOUNDS, np.abs(planes.distances))
    thickness_class = np.searchsorted(_THICKNESS_BOUNDS, planes.thickness)
    classes = distance_class * (len(_THICKNESS_BOUNDS) + 1) + thickness_class
    return LocalPlanes(planes.normals, planes.distances, classes)

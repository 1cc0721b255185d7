"""Voxel mode: voxels of G-PCC's octree, displaced along normals, for clouds without surfaces."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.codecs.gpcc.lossless import decode_voxels, encode_voxels
from puckbench.codecs.primitives.displacements import displace, fit_displacements
from puckbench.codecs.primitives.octree import group_by_key
from puckbench.codecs.primitives.octree_arrays import Ints
from puckbench.codecs.primitives.settings import UNITS
from puckbench.codecs.primitives.stream import (
    CLASSES,
    MAX_DISPLACED,
    MAX_HYBRID_VOXELS,
    DisplacementTable,
    GridPlacement,
    VoxelHeader,
    pack_voxels,
    unpack,
)
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

_FINEST = UNITS / (1 << 20)
_MAX_TRIALS = 6
_BUDGET_SLACK = 0.04
"""Share of the byte budget that the search may leave unused."""
_MIN_ERROR_PER_BYTE = 0.5
"""Share of the squared error that a table must save for each share of the bytes that it takes."""
_TYPICAL_SLOPE = 2.2


class Voxelised(NamedTuple):
    """Voxels (m, 3), the means (m, 3) of their points, and the numbers (m,) of these."""

    voxels: Ints
    means: Floats
    counts: Floats


def voxelise(points: Floats) -> Voxelised:
    """Round points (n, 3), given in voxels."""
    voxels = np.rint(points).astype(np.int64)
    order, starts = group_by_key(voxels - voxels.min(axis=0))
    counts = np.diff(np.concatenate([starts, [len(points)]])).astype(np.float64)
    means = np.add.reduceat(points[order], starts, axis=0) / counts[:, None]
    return Voxelised(voxels[order[starts]], means, counts)


def encode_voxel_size(points: Floats, size: float) -> bytes:
    """A stream of the voxels of side `size` that points (n, 3) lie in."""
    place = GridPlacement(points.min(axis=0), size).rounded()
    voxelised = voxelise((points - place.origin) / place.cell_size)
    bits = encode_voxels(voxelised.voxels)
    return pack_voxels(place, _displacements(voxelised, len(bits)), bits)


def encode_to_budget(points: Floats, max_bytes: int, max_voxel_size: float = UNITS / 4) -> bytes:
    """Code the finest voxels that take no more than about `max_bytes` bytes.

    Parameters
    ----------
    points
        (n, 3) points.
    max_bytes
        The budget.
    max_voxel_size
        Bound of the voxels' side in units of 1/1023 of the extent, even if they take more bytes.
    """
    extent = float(np.ptp(points, axis=0).max())
    if extent == 0:
        return encode_voxel_size(points, 1.0)
    max_bytes = max(max_bytes, 1)
    finest, coarsest = extent / UNITS * _FINEST, extent / UNITS * max_voxel_size
    size, slope = min(_initial_size(points, extent, max_bytes), coarsest), _TYPICAL_SLOPE
    best = b""
    tried: list[tuple[float, int]] = []
    for _ in range(_MAX_TRIALS):
        stream = encode_voxel_size(points, size)
        if len(stream) <= max_bytes and len(stream) > len(best):
            best = stream
        if max_bytes * (1 - _BUDGET_SLACK) <= len(stream) <= max_bytes:
            break
        if len(stream) > max_bytes and size == coarsest:
            break
        tried.append((size, len(stream)))
        if len(tried) > 1:
            slope = _slope(tried[-2], tried[-1], slope)
        size *= (len(stream) / (max_bytes * (1 - _BUDGET_SLACK / 2))) ** (1 / slope)
        size = min(max(size, finest), coarsest)
    return best or stream


def decode(place: GridPlacement, table: DisplacementTable | None, bits: bytes) -> Floats:
    """Points (m, 3) of voxels; InputError for a damaged stream."""
    voxels = decode_voxels(bits) if table is None else decode_voxels(bits, MAX_DISPLACED)
    return _placed(place, table, voxels)


def without_displacements(stream: bytes) -> bytes:
    """The stream of the same voxels that stay in their centres."""
    place, _, bits = _unpacked(stream)
    return pack_voxels(place, None, bits)


def decode_undisplaced(stream: bytes) -> Floats:
    """The voxels' centres (m, 3), as G-PCC decodes them."""
    place, _, bits = _unpacked(stream)
    return decode(place, None, bits)


def decoded_voxels(stream: bytes) -> tuple[GridPlacement, Ints, Floats]:
    """Grid, voxels (m, 3), and displaced points (m, 3) of a stream; InputError for another kind."""
    place, table, bits = _unpacked(stream)
    voxels = decode_voxels(bits, MAX_HYBRID_VOXELS)
    return place, voxels, _placed(place, table, voxels)


def _unpacked(stream: bytes) -> tuple[GridPlacement, DisplacementTable | None, bytes]:
    header, bits = unpack(stream)
    if not isinstance(header, VoxelHeader):
        raise InputError("the stream holds no voxels")
    return header.place, header.table, bits


def _placed(place: GridPlacement, table: DisplacementTable | None, voxels: Ints) -> Floats:
    """Points (m, 3) of decoded voxels (m, 3), displaced by the table."""
    xyz = displace(voxels, table) if table is not None and len(voxels) else voxels
    return np.asarray(xyz * place.cell_size + place.origin)


def _displacements(voxelised: Voxelised, voxel_bytes: int) -> DisplacementTable | None:
    """The best displacements; None if they save less of the error than they add to the bytes."""
    counts = voxelised.counts
    if len(counts) > MAX_DISPLACED:
        return None
    weights = counts / counts.sum() + 1 / len(counts)
    table, gain = fit_displacements(voxelised.voxels, voxelised.means, weights)
    error = (weights[:, None] * (voxelised.voxels - voxelised.means) ** 2).sum()
    return table if gain > _MIN_ERROR_PER_BYTE * CLASSES / voxel_bytes * error else None


def _initial_size(points: Floats, extent: float, max_bytes: int) -> float:
    """A side to begin with, at two bits for each of the voxels of a surface."""
    wanted = max(4.0 * max_bytes, 8.0)
    size = extent / 64
    count = len(voxelise(points / size).voxels)
    return float(size * max(count / wanted, 1e-6) ** 0.5)


def _slope(a: tuple[float, int], b: tuple[float, int], default: float) -> float:
    """Exponent with which bytes fall as voxels grow, from two trials (side, bytes)."""
    if a[0] == b[0] or a[1] == b[1]:
        return default
    return float(np.clip(np.log(a[1] / b[1]) / np.log(b[0] / a[0]), 0.5, 3.5))

"""Voxels of G-PCC's octree with a table of how they move: what is coded where no surface is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.codecs.gpcc.lossless import decode_voxels, encode_voxels
from puckbench.codecs.primitives.displacements import best_table, moved
from puckbench.codecs.primitives.layout import Ints
from puckbench.codecs.primitives.settings import SIZE
from puckbench.codecs.primitives.stream import BINS, Place, Table, Voxels, pack_voxels, unpack
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

_FINEST = SIZE / (1 << 20)
_TRIES = 6
_CLOSE = 0.04
"""Share of the bytes asked for that the search may leave unused."""
_WORTH = 0.5
"""Share of the squared error that a table has to save for each share of the bytes that it takes."""


class Voxelised(NamedTuple):
    """Voxels (m, 3), the means (m, 3) of their points and the points' numbers (m,)."""

    voxels: Ints
    means: Floats
    counts: Floats


def voxelised(points: Floats) -> Voxelised:
    """Round points (n, 3), in voxels."""
    voxels = np.rint(points).astype(np.int64)
    shifted = voxels - voxels.min(axis=0)
    keys = (shifted[:, 0] << 42) | (shifted[:, 1] << 21) | shifted[:, 2]
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    counts = np.diff(np.concatenate([starts, [len(points)]])).astype(np.float64)
    means = np.add.reduceat(points[order], starts, axis=0) / counts[:, None]
    return Voxelised(voxels[order[starts]], means, counts)


def encode_at(points: Floats, side: float) -> bytes:
    """A stream of the voxels of `side` that points (n, 3) lie in."""
    place = Place(points.min(axis=0), side).rounded()
    found = voxelised((points - place.origin) / place.unit)
    bits = encode_voxels(found.voxels)
    return pack_voxels(place, _table(found, _WORTH * BINS / len(bits)), bits)


def encode_within(points: Floats, most: int, largest: float = SIZE / 4) -> bytes:
    """The stream of the least voxels that takes no more than about `most` bytes.

    largest: side that voxels do not exceed even if they take more, in units of 1/1023 extents.
    """
    extent = float(np.ptp(points, axis=0).max())
    if extent == 0:
        return encode_at(points, 1.0)
    most = max(most, 1)
    finest, coarsest = extent / SIZE * _FINEST, extent / SIZE * largest
    side, slope = min(_guess(points, extent, most), coarsest), 2.2
    best = b""
    tried: list[tuple[float, int]] = []
    for _ in range(_TRIES):
        stream = encode_at(points, side)
        if len(stream) <= most and len(stream) > len(best):
            best = stream
        if most * (1 - _CLOSE) <= len(stream) <= most:
            break
        if len(stream) > most and side == coarsest:
            break
        tried.append((side, len(stream)))
        if len(tried) > 1:
            slope = _slope(tried[-2], tried[-1], slope)
        side *= (len(stream) / (most * (1 - _CLOSE / 2))) ** (1 / slope)
        side = min(max(side, finest), coarsest)
    return best or stream


def decode(place: Place, table: Table | None, bits: bytes) -> Floats:
    """Points (m, 3); InputError for a damaged stream."""
    voxels = decode_voxels(bits)
    xyz = moved(voxels, table) if table is not None and len(voxels) else voxels
    return np.asarray(xyz * place.unit + place.origin)


def unmoved(stream: bytes) -> Floats:
    """Points of a stream of voxels where G-PCC has them, in the middle of the cells."""
    header, bits = unpack(stream)
    if not isinstance(header, Voxels):
        raise InputError("the stream holds no voxels")
    return decode(header.place, None, bits)


def _table(found: Voxelised, least: float) -> Table | None:
    """The best table; None if it saves less than a share `least` of the squared error."""
    weights = found.counts / found.counts.sum() + 1 / len(found.counts)
    table, gain = best_table(found.voxels, found.means, weights)
    error = (weights[:, None] * (found.voxels - found.means) ** 2).sum()
    return table if gain > least * error else None


def _guess(points: Floats, extent: float, most: int) -> float:
    """A side of voxels to begin with: two bits for each of the voxels of a surface."""
    wanted = max(4.0 * most, 8.0)
    side = extent / 64
    count = len(voxelised(points / side).voxels)
    return float(side * max(count / wanted, 1e-6) ** 0.5)


def _slope(a: tuple[float, int], b: tuple[float, int], usual: float) -> float:
    """Exponent with which bytes fall as voxels grow, from two of them."""
    if a[0] == b[0] or a[1] == b[1]:
        return usual
    return float(np.clip(np.log(a[1] / b[1]) / np.log(b[0] / a[0]), 0.5, 3.5))

"""The stream of the sparse octree net, which contains in this order:

* magic "PBON", version, CRC-32 of the rest
* digest of the weights (8 bytes), scale (float64), origin (3 int32), grid (uint8: 0 for the
  default; or 1, followed by unit and offset, 4 float64), number of parts (uint8)
* for each part of the cloud: number of voxels (uint32), number of levels that the network codes
  (uint8), lengths in bytes of top level (uint16) and symbols (uint32), top level, symbols
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcc.grid import InputGrid
from pcc_networks.sparse.voxels import AXIS_BITS
from pointkit.coding.byte_io import Reader
from pointkit.coding.framing import Framing
from pointkit.errors import InputError

MAGIC, VERSION = b"PBON", 3
MAX_VOXELS = 2**21
"""Maximum voxels of a part; larger clouds are cut to bound working memory."""
_MAX_TOTAL = 2**25
_TOTAL, _TOTAL_PER_BYTE = 5 * 2**19, 64
"""Maximum voxels of all parts, and additional voxels per byte of symbols."""
_MAX_VOXELS_PER_BYTE = 2**14
"""Maximum voxels per byte: eight decisions of at least 0.0007 bits each decode up to 8 voxels."""
_NODES, _NODES_PER_BYTE = 2**17, 4
"""Levels above the finest may have `_NODES` voxels, 3/8 of the finest level's voxels (a plane needs
1/3), and `_NODES_PER_BYTE` voxels per byte. The network takes about 4 microseconds per voxel."""
_MIN_SCALE = 2.0**-400
"""Minimum scale; with smaller scales, coordinates could overflow."""
_FRAMING = Framing(MAGIC, VERSION, "sparse octree net")
_HEADER = struct.Struct("<8sd3iB")
_GRID = struct.Struct("<4d")
_COUNT = struct.Struct("<B")
_PART = struct.Struct("<IBHI")


@dataclass(frozen=True)
class CodedPart:
    """A part of a cloud that was encoded separately."""

    count: int  # number of voxels
    levels: int  # that the network codes
    top: bytes  # coded voxels of the top level
    symbols: bytes


@dataclass(frozen=True)
class OctreeNetStream:
    """The numbers in the header of a stream, and its parts, which are still encoded."""

    digest: bytes  # of the weights
    scale: float
    origin: tuple[int, int, int]
    grid: InputGrid
    parts: tuple[CodedPart, ...]


def write_stream(content: OctreeNetStream) -> bytes:
    """Return the bytes of a stream.

    Raises InputError if there are more voxels than a decoder accepts.
    """
    if sum(part.count for part in content.parts) > _MAX_TOTAL:
        raise InputError(f"the cloud has more than {_MAX_TOTAL} voxels")
    _check(content.parts)
    has_grid = content.grid != InputGrid()
    body = [_HEADER.pack(content.digest, content.scale, *content.origin, has_grid)]
    if has_grid:
        body.append(_GRID.pack(content.grid.unit, *content.grid.offset))
    body.append(_COUNT.pack(len(content.parts)))
    for part in content.parts:
        sizes = (len(part.top), len(part.symbols))
        body += [_PART.pack(part.count, part.levels, *sizes), part.top, part.symbols]
    return _FRAMING.framed(b"".join(body))


def read_stream(stream: bytes) -> OctreeNetStream:
    """Divide a stream into its header and its parts, without decoding the parts.

    Raises
    ------
    InputError
        If the stream is damaged, or of another codec or version.
    """
    reader = Reader(_FRAMING.unframed(stream)[1])
    digest, scale, x, y, z, has_grid = _HEADER.unpack(reader.take(_HEADER.size))
    grid = _read_grid(reader) if has_grid else InputGrid()
    (count,) = _COUNT.unpack(reader.take(_COUNT.size))
    parts = tuple(_read_part(reader) for _ in range(count))
    if reader.rest() or not parts:
        raise InputError("the stream is damaged (its length)")
    _check(parts)
    if not _MIN_SCALE < scale < np.inf:
        raise InputError("the stream is damaged (its scale)")
    return OctreeNetStream(digest, scale, (x, y, z), grid, parts)


def _read_grid(reader: Reader) -> InputGrid:
    unit, *offset = _GRID.unpack(reader.take(_GRID.size))
    if not (0 < unit < 2.0**500 and np.abs(offset).max() < 2.0**500):
        raise InputError("the stream is damaged (its grid)")
    return InputGrid(unit, (offset[0], offset[1], offset[2]))


def _read_part(reader: Reader) -> CodedPart:
    voxels, levels, top, symbols = _PART.unpack(reader.take(_PART.size))
    return CodedPart(voxels, levels, reader.take(top), reader.take(symbols))


def max_nodes(part: CodedPart) -> int:
    """Return how many voxels a decoder accepts on all levels of a part above the finest."""
    return _NODES + 3 * part.count // 8 + _NODES_PER_BYTE * len(part.symbols)


def _check(parts: Sequence[CodedPart]) -> None:
    for part in parts:
        max_voxels = min(MAX_VOXELS, 65536 + _MAX_VOXELS_PER_BYTE * len(part.symbols))
        if not 0 < part.count <= max_voxels or part.levels >= AXIS_BITS:
            raise InputError("the stream is damaged (too many voxels for its size)")
    voxels = sum(part.count for part in parts)
    max_voxels = _TOTAL + _TOTAL_PER_BYTE * sum(len(part.symbols) for part in parts)
    if voxels > min(max_voxels, _MAX_TOTAL) or len(parts) != -(-voxels // MAX_VOXELS):
        raise InputError("the stream is damaged (too many voxels for its size)")

"""The stream of RENO: an identifying header, then the stream of the authors' program.

* magic "RENO", version, CRC-32 of the rest
* digest of the weights (8 bytes), number of decoded voxels (uint32), CRC-32 of their sorted Morton
  keys, 8 bytes each (uint32); offsets of the grid in 131,072 mm (3 signed base-128 numbers)
* authors' stream: posQ in mm (float16); voxels of the base (coarsest level): number (int32),
  coordinates (3 int32 each), occupancies (uint8 each); number of runs of symbols (uint16); each
  run, preceded by its length in bytes (uint32). Each level below the base has a run of first
  symbols and a run of second symbols.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcc_networks.sparse.voxels import AXIS_BITS, morton_keys
from pointkit.coding.byte_io import Reader, signed_128
from pointkit.coding.framing import Framing
from pointkit.errors import InputError

MAGIC, VERSION = b"RENO", 1
MAX_BASE = 64
"""The base has fewer voxels than this."""
MAX_LEVEL = 2**22
"""Maximum voxels of a level that the network codes; each takes about 600 bytes of memory."""
_NODES, _NODES_PER_BYTE = 2**17, 16
"""Maximum voxels of all network-coded levels, and additional voxels per byte of the symbols."""
_MAX_OFFSET = 2**30
_FRAMING = Framing(MAGIC, VERSION, "RENO")
_HEADER = struct.Struct("<8sII")
_BASE = struct.Struct("<ei")
_RUNS, _LENGTH = struct.Struct("<H"), struct.Struct("<I")
Triple = tuple[int, int, int]


@dataclass(frozen=True)
class CodedTree:
    """An encoded octree of voxels."""

    base: NDArray[np.int64]  # (m, 3), voxels of the coarsest level, in Morton order
    occupancy: NDArray[np.uint8]  # (m,), of their children
    symbols: tuple[bytes, ...]  # coded first and second symbols of each level below the base
    count: int  # number of decoded voxels
    check: int  # CRC-32 of their keys


@dataclass(frozen=True)
class RenoStream:
    """The numbers in the header of a RENO stream, and its octree, which is still encoded."""

    digest: bytes  # of the weights
    posq: float  # step in mm
    offsets: Triple  # of the grid, in 131,072 mm
    tree: CodedTree


def write_stream(content: RenoStream) -> bytes:
    """Return the bytes of a stream."""
    tree = content.tree
    parts = [
        _HEADER.pack(content.digest, tree.count, tree.check),
        *map(signed_128, content.offsets),
    ]
    parts += [_BASE.pack(content.posq, len(tree.base)), tree.base.astype("<i4").tobytes()]
    parts += [tree.occupancy.tobytes(), _RUNS.pack(len(tree.symbols))]
    for run in tree.symbols:
        parts += [_LENGTH.pack(len(run)), run]
    return _FRAMING.framed(b"".join(parts))


def read_stream(stream: bytes) -> RenoStream:
    """Divide a stream into its header and its octree, without decoding the octree.

    Raises
    ------
    InputError
        If the stream is damaged, or of another codec or version.
    """
    reader = Reader(_FRAMING.unframed(stream)[1])
    digest, count, check = _HEADER.unpack(reader.take(_HEADER.size))
    offsets = (reader.signed(), reader.signed(), reader.signed())
    posq, size = _BASE.unpack(reader.take(_BASE.size))
    if not 0 < size < MAX_BASE or not 0 < posq < np.inf or max(map(abs, offsets)) > _MAX_OFFSET:
        raise InputError("the stream is damaged (its header)")
    base = np.frombuffer(reader.take(12 * size), "<i4").reshape(-1, 3).astype(np.int64)
    occupancy = np.frombuffer(reader.take(size), np.uint8)
    (runs,) = _RUNS.unpack(reader.take(_RUNS.size))
    symbols = tuple(
        reader.take(_LENGTH.unpack(reader.take(_LENGTH.size))[0]) for _ in range(min(runs, 64))
    )
    tree = CodedTree(base, occupancy, symbols, count, check)
    _check_base(tree)
    if reader.at != len(reader.body) or len(symbols) != runs:
        raise InputError("the stream is damaged (its length)")
    check_work(tree, 0)
    return RenoStream(digest, posq, offsets, tree)


def _check_base(tree: CodedTree) -> None:
    levels, odd = divmod(len(tree.symbols), 2)
    side = 2 ** max(AXIS_BITS - levels - 1, 0)
    inside = not odd and tree.base.min() >= 0 and tree.base.max() < side
    if not inside or not tree.occupancy.all() or (np.diff(morton_keys(tree.base)) <= 0).any():
        raise InputError("the stream is damaged (its base)")


def max_nodes(tree: CodedTree) -> int:
    """Return how many network-coded voxels a decoder accepts for a tree, over all levels.

    The number depends on the size of the coded symbols.
    """
    return _NODES + _NODES_PER_BYTE * sum(map(len, tree.symbols))


def check_work(tree: CodedTree, nodes: int) -> None:
    """Raise InputError if decoding would take too long for the size of an encoded tree.

    Parameters
    ----------
    tree
        The encoded tree.
    nodes
        Number of voxels of all network-coded levels.
    """
    if nodes > max_nodes(tree) or tree.count > 8 * max_nodes(tree):
        raise InputError("the stream is damaged (too many voxels for its size)")

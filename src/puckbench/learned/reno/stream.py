"""The stream of RENO: what its authors' program writes, behind a header that makes it whole.

magic "RENO", version, CRC-32 of all that follows
digest of the weights (8 bytes), number and CRC-32 of the decoded voxels (2 uint32): their keys in
    Morton order, 8 bytes each; base-128 numbers: offsets of the axes in 131,072 mm (signed)
as the authors' program: posQ in mm (float16), voxels of the base (int32), their coordinates (3
    int32 each) and occupancies (uint8 each), number of runs of symbols (uint16), each run's bytes
    (uint32) and the run: first and second symbols of each level below the base
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from puckbench.coding.byte_io import Reader, signed_128
from puckbench.coding.framing import Framing
from puckbench.core.errors import InputError
from puckbench.learned.sparse.voxels import AXIS_BITS, morton_keys

MAGIC, VERSION = b"RENO", 1
MAX_BASE = 64
"""The base has fewer voxels."""
MAX_LEVEL = 2**22
"""Voxels of a level that the network codes: each takes some 600 bytes of memory."""
_NODES, _NODES_PER_BYTE = 2**17, 16
"""Voxels of all such levels, at most, and for each byte of the symbols."""
_MAX_OFFSET = 2**30
_FRAMING = Framing(MAGIC, VERSION, "RENO")
_HEADER = struct.Struct("<8sII")
_BASE = struct.Struct("<ei")
_RUNS, _LENGTH = struct.Struct("<H"), struct.Struct("<I")
Triple = tuple[int, int, int]


@dataclass(frozen=True)
class CodedTree:
    """Coded voxels.

    Parameters
    ----------
    base
        (m, 3) int64, the voxels of the coarsest level, in Morton order.
    occupancy
        (m,) uint8, which of their children are occupied.
    symbols
        Of each level below the base the first and the second symbols, coded.
    count, check
        Number of the decoded voxels and CRC-32 of their keys.
    """

    base: NDArray[np.int64]
    occupancy: NDArray[np.uint8]
    symbols: tuple[bytes, ...]
    count: int
    check: int


@dataclass(frozen=True)
class RenoStream:
    """A coded cloud: identity of the weights, step (mm), offsets (131,072 mm), voxels."""

    digest: bytes
    posq: float
    offsets: Triple
    tree: CodedTree


def write_stream(coded: RenoStream) -> bytes:
    """The bytes of a coded cloud."""
    tree = coded.tree
    parts = [_HEADER.pack(coded.digest, tree.count, tree.check), *map(signed_128, coded.offsets)]
    parts += [_BASE.pack(coded.posq, len(tree.base)), tree.base.astype("<i4").tobytes()]
    parts += [tree.occupancy.tobytes(), _RUNS.pack(len(tree.symbols))]
    for run in tree.symbols:
        parts += [_LENGTH.pack(len(run)), run]
    return _FRAMING.framed(b"".join(parts))


def read_stream(stream: bytes) -> RenoStream:
    """Parse a stream; the counts in it are checked against its size before any work begins.

    Raises
    ------
    InputError
        The bytes are damaged, or of another codec or version.
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
    """Voxels of all levels that the network codes, at most, for a stream of its size."""
    return _NODES + _NODES_PER_BYTE * sum(map(len, tree.symbols))


def check_work(tree: CodedTree, nodes: int) -> None:
    """A damaged stream must not keep the decoder busy for long, and no encoder makes one.

    Parameters
    ----------
    tree
        Coded voxels.
    nodes
        Voxels of the levels that the network codes, as far as they are known.
    """
    if nodes > max_nodes(tree) or tree.count > 8 * max_nodes(tree):
        raise InputError("more voxels than a stream of its size may have")

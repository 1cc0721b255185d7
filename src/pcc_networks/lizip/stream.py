"""The stream of LiZIP: an identifying header, then a file of the authors' program.

* magic "LIZI", version, CRC-32 of the rest
* digest of the weights (8 bytes), CRC-32 of the decoded steps, 12 bytes a point (uint32)
* authors' file: magic "LIZP", number of the compressor (uint8), points stored at the start of a
  block (uint8), 2 zeros, numbers of points and of blocks (uint32 each), steps of the grid in a
  metre (float32), 3 (uint32); then the compressed numbers

The numbers are int32: those of the stored points, then those of the others, each as all lowest
bytes, then all second bytes, and so on. A block has 128 points. Its first 5 are stored, as
differences to the point before in the list of stored points. For the others, differences to their
predictions follow. The last block is filled with zeros.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pcc_networks.lizip.compression import Compression, compressed, decompressed
from pcc_networks.lizip.weights import HEAD
from pointkit.coding.framing import Framing
from pointkit.errors import InputError

MAGIC, VERSION = b"LIZI", 1
BLOCK = 128
"""Points of a block."""
MAX_POINTS = 2**24
"""Points of a stream at most: their numbers fill one block of LZMA."""
_POINTS, _POINTS_PER_BYTE = 2**17, 8
"""Maximum points, and additional points per byte of the compressed numbers."""
_FRAMING = Framing(MAGIC, VERSION, "LiZIP")
_OURS = struct.Struct("<8sI")
_THEIRS = struct.Struct("<4sBB2sIIfI")
_THEIR_MAGIC, _SHUFFLED = b"LIZP", 3
LEAST_SCALE, MOST_SCALE = 1e-3, 1e7
"""Limits of the steps in a metre."""
Words = NDArray[np.int32]


@dataclass(frozen=True)
class LizipStream:
    """The contents of a stream of LiZIP.

    The numbers are decompressed when a decoder asks for them (`numbers`).
    """

    digest: bytes  # of the weights
    check: int  # CRC-32 of the decoded steps
    points: int  # number of points, n
    scale: float  # steps of the grid in a metre, in single precision
    compressor: int  # its number
    packed: bytes  # compressed numbers

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.points // BLOCK)

    def numbers(self) -> tuple[Words, Words]:
        """Decompress the stored points (blocks, 5, 3), and the differences (blocks, 123, 3)."""
        stored = 3 * HEAD * self.blocks
        size = 4 * 3 * BLOCK * self.blocks
        raw = np.frombuffer(decompressed(self.packed, self.compressor, size), np.uint8)
        heads, others = _joined(raw[: 4 * stored]), _joined(raw[4 * stored :])
        points = heads.reshape(-1, 3).cumsum(axis=0, dtype=np.int32)
        return points.reshape(-1, HEAD, 3), others.reshape(-1, BLOCK - HEAD, 3)


def packed_numbers(heads: Words, differences: Words, compression: Compression) -> bytes:
    """Compress the numbers of a stream.

    Parameters
    ----------
    heads
        Stored points (blocks, 5, 3), in steps of the grid.
    differences
        Differences (blocks, 123, 3) of the other points to their predictions.
    compression
        Name of the compressor.
    """
    points = heads.reshape(-1, 3)
    steps = np.diff(points, axis=0, prepend=np.zeros((1, 3), np.int32))
    return compressed(_divided(steps) + _divided(differences), compression)


def _divided(numbers: Words) -> bytes:
    return numbers.astype("<i4").view(np.uint8).reshape(-1, 4).T.tobytes()


def _joined(data: NDArray[np.uint8]) -> Words:
    numbers: Words = np.ascontiguousarray(data.reshape(4, -1).T).view("<i4").ravel()
    return numbers.astype(np.int32, copy=False)


def authors_file(content: LizipStream) -> bytes:
    """Return the part of a stream that is a file of the authors' program."""
    sizes = (content.points, content.blocks, content.scale, _SHUFFLED)
    head = _THEIRS.pack(_THEIR_MAGIC, content.compressor, HEAD, bytes(2), *sizes)
    return head + content.packed


def write_stream(content: LizipStream) -> bytes:
    """Return the bytes of a stream.

    Raises InputError if a decoder would refuse it, since it has too many points for its size.
    """
    check_work(content)
    return _FRAMING.framed(_OURS.pack(content.digest, content.check) + authors_file(content))


def read_stream(stream: bytes) -> LizipStream:
    """Divide a stream into its header and its numbers, which stay compressed.

    Raises
    ------
    InputError
        If the stream is damaged, or of another codec or version.
    """
    body = _FRAMING.unframed(stream)[1]
    if len(body) < _OURS.size + _THEIRS.size:
        raise InputError("the stream is truncated")
    digest, check = _OURS.unpack_from(body)
    magic, compressor, head, zeros, points, blocks, scale, kind = _THEIRS.unpack_from(
        body, _OURS.size
    )
    packed = body[_OURS.size + _THEIRS.size :]
    content = LizipStream(digest, check, points, scale, compressor, packed)
    known = (magic, head, zeros, kind) == (_THEIR_MAGIC, HEAD, bytes(2), _SHUFFLED)
    if not known or blocks != content.blocks or not LEAST_SCALE <= scale <= MOST_SCALE:
        raise InputError("the stream is damaged (its header)")
    check_work(content)
    return content


def check_work(content: LizipStream) -> None:
    """Raise InputError if decoding would take too long for the size of a stream, or for any."""
    most = min(_POINTS + _POINTS_PER_BYTE * len(content.packed), MAX_POINTS)
    if not 0 < content.points <= most:
        raise InputError(f"{content.points} points are too many for a stream of this size")

"""Encoder and decoder of points as LAZ (compressed LAS 1.2, point format 0) by laspy and lazrs."""

from __future__ import annotations

import struct
from io import BytesIO

import numpy as np
from numpy.typing import NDArray

from cloud_files.las import las_bytes, las_points
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from puckbench.codecs.storage.steps import check_points_of, in_steps

MAGIC = b"LASF"
_HEADER_BYTES = 227
_STARTS = struct.Struct("<HIIBHI")
"""Header fields from byte 94: header size, position of the points, number of variable length
records, point format, size of a point, number of points."""
_POINT_FORMAT, _POINT_BYTES, _COMPRESSED = 0, 20, 128
_STARTS_AT, _SCALES_AT = 94, 131
_RECORD_HEADER_BYTES = 54
_MOST_SCALE = 1e290
_CHUNKS_AT, _CHUNKS = struct.Struct("<q"), struct.Struct("<II")
"""Before the points, position of the chunk table; the table's first fields: version and number of
chunks."""


Intensities = NDArray[np.uint16]


def encode_laz(points: Floats, step: float, intensities: Intensities | None = None) -> bytes:
    """Encode points as LAZ, in their order.

    Parameters
    ----------
    points
        Points (n, 3) in m.
    step
        Resolution in m, to whose multiples coordinates are rounded.
    intensities
        Intensities (n,) of 16 bits, which are encoded losslessly; by default none.

    Raises
    ------
    InputError
        A coordinate exceeds 31 bits.
    """
    las = las_points(in_steps(points, step), step, np.zeros(3), _POINT_FORMAT)
    las.header.system_identifier, las.header.generating_software = "OTHER", "puckbench"
    if intensities is not None:
        las.intensity = intensities
    stream = las_bytes(las, is_compressed=True)
    check_points_of(len(points), stream)
    return stream


def intensity_bytes(stream: bytes) -> int:
    """Return how many bytes of a LAZ stream its intensities take.

    LAZ does not store them separately, so the points are encoded again without intensities.
    """
    points, intensities = decode_laz(stream)
    step = float(np.frombuffer(stream, "<f8", 1, _SCALES_AT)[0])
    return len(stream) - len(encode_laz(points, step)) if intensities.any() else 0


def decode_laz(stream: bytes) -> tuple[Floats, Intensities]:
    """Decode a LAZ stream that `encode_laz` wrote.

    Returns
    -------
    tuple
        Points (n, 3) in m, and intensities (n,), which are 0 if there are none.

    Raises
    ------
    InputError
        The stream is damaged, or written by another program (see `cloud_files.las` for such files).
    """
    import lazrs

    vlr = lazrs.LazVlr.new_for_compression(_POINT_FORMAT, 0)
    begin = _HEADER_BYTES + _RECORD_HEADER_BYTES + len(vlr.record_data())
    count, scale = _checked_header(stream, begin, vlr.record_data())
    _check_chunks(stream, begin, -(-count // vlr.chunk_size()))
    records = bytearray(_POINT_BYTES * count)
    source = BytesIO(stream)
    source.seek(begin)
    try:
        selection = lazrs.DecompressionSelection(lazrs.SELECTIVE_DECOMPRESS_ALL)
        decoder = lazrs.LasZipDecompressor(source, vlr.record_data(), selection)
        decoder.decompress_many(records)
    except (lazrs.LazrsError, OSError, ValueError) as error:
        raise InputError("the stream is damaged (LAZ)") from error
    words = np.frombuffer(records, np.dtype("<i4")).reshape(count, -1)
    return words[:, :3] * scale, (words[:, 3] & 0xFFFF).astype(np.uint16)


def _checked_header(stream: bytes, begin: int, vlr: bytes) -> tuple[int, Floats]:
    """Check that `encode_laz` wrote the header, and return the point count and the scales (3,).

    The points begin at byte `begin`, after the LAZ record `vlr`.
    """
    if len(stream) < begin + _CHUNKS_AT.size:
        raise InputError("the stream is truncated")
    *starts, count = _STARTS.unpack_from(stream, _STARTS_AT)
    scale, offset = np.frombuffer(stream, "<f8", 6, _SCALES_AT).reshape(2, 3)
    made = [_HEADER_BYTES, begin, 1, _POINT_FORMAT | _COMPRESSED, _POINT_BYTES]
    is_ours = stream[begin - len(vlr) : begin] == vlr and not offset.any()
    if stream[:4] != MAGIC or starts != made or not is_ours:
        raise InputError("not LAZ as puckbench writes it: intensities alone beside points")
    check_points_of(count, stream)
    if not ((scale > 0) & (scale < _MOST_SCALE)).all():
        raise InputError("the stream is damaged (its scale)")
    return count, scale


def _check_chunks(stream: bytes, begin: int, chunks: int) -> None:
    """Raise InputError if the number of chunks, for which lazrs allocates memory, is wrong."""
    (at,) = _CHUNKS_AT.unpack_from(stream, begin)
    if not begin < at <= len(stream) - _CHUNKS.size or _CHUNKS.unpack_from(stream, at)[1] != chunks:
        raise InputError("the stream is damaged (its table of chunks)")

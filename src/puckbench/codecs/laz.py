"""LAZ, the compressed form of LAS 1.2, by laspy and lazrs: geometry alone, in steps of the rate."""

from __future__ import annotations

import struct
from datetime import date
from importlib.metadata import version
from io import BytesIO
from typing import Any

import numpy as np

from puckbench.codecs.base import Codec, Pace, Parameters, lengths
from puckbench.codecs.registry import CODECS
from puckbench.codecs.steps import MOST_STEPS, check_points_of, in_steps
from puckbench.core.errors import InputError, naming
from puckbench.geometry.cloud import Floats

_DATE = date(2000, 1, 1)
"""The same points give the same bytes on any day."""
_HEADER_BYTES = 227
_STARTS = struct.Struct("<HIIBHI")
"""At byte 94: bytes of the header, where points begin, further records, format, bytes of a point,
points."""
_POINT_FORMAT, _POINT_BYTES, _COMPRESSED = 0, 20, 128
_STARTS_AT, _SCALES_AT = 94, 131
_RECORD_HEADER_BYTES = 54
_MOST_SCALE = 1e290
_CHUNKS_AT, _CHUNKS = struct.Struct("<q"), struct.Struct("<II")
"""Before the points: where the table of chunks is. At its start: its version, and their number."""


@CODECS.register("laz")
class Laz(Codec):
    """LAZ (LAS 1.2, point format 0), coordinates in steps of the rate; keeps the order."""

    title = "LAZ"
    use = "what surveyors' programs read"
    colour = "#66A61E"
    marker = "3"
    line = "--"
    rank = 160
    pace = Pace(0.05, 1.5)
    metric_rates = lengths()
    most_steps = MOST_STEPS
    magic = b"LASF"
    version = f"laspy {version('laspy')}, lazrs {version('lazrs')}"

    def load(self) -> None:
        """Import the libraries."""
        import laspy  # noqa: F401
        import lazrs  # noqa: F401

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        import laspy

        packed = BytesIO()
        with naming(f"codec {self.name}"):
            data = _las(points, float(parameters["step_m"]))
            data.write(packed, do_compress=True, laz_backend=laspy.LazBackend.Lazrs)
            stream = packed.getvalue()
            check_points_of(len(points), stream)
        return stream

    def _decode(self, stream: bytes) -> Floats:
        with naming(f"codec {self.name}"):
            return _points(stream)


def _las(points: Floats, step: float) -> Any:
    """Points as LAS data; no attribute has a value."""
    import laspy

    steps = in_steps(points, step).astype(np.int32)
    header = laspy.LasHeader(point_format=_POINT_FORMAT, version="1.2")
    header.scales, header.offsets = np.full(3, step), np.zeros(3)
    header.creation_date, header.system_identifier = _DATE, "OTHER"
    header.generating_software = "puckbench"
    las = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(len(steps), header=header))
    las.X, las.Y, las.Z = steps.T
    return las


def _points(stream: bytes) -> Floats:
    """Points (n, 3) of LAZ as `_las` makes it; what it does not make is refused unread.

    Programs of others may write other headers: `puckbench.io.las` reads those.
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
    steps = np.frombuffer(records, np.dtype("<i4")).reshape(count, -1)[:, :3]
    return steps * scale


def _checked_header(stream: bytes, begin: int, vlr: bytes) -> tuple[int, Floats]:
    """Number of points and scales (3,); InputError for a header that `_las` does not make.

    Parameters
    ----------
    stream
        All of it.
    begin
        Where the points begin.
    vlr
        The record that says how they are packed, which stands before them.
    """
    if len(stream) < begin + _CHUNKS_AT.size:
        raise InputError("the stream is truncated")
    *starts, count = _STARTS.unpack_from(stream, _STARTS_AT)
    scale, offset = np.frombuffer(stream, "<f8", 6, _SCALES_AT).reshape(2, 3)
    made = [_HEADER_BYTES, begin, 1, _POINT_FORMAT | _COMPRESSED, _POINT_BYTES]
    is_packed_so = stream[begin - len(vlr) : begin] == vlr and not offset.any()
    if stream[:4] != Laz.magic or starts != made or not is_packed_so:
        raise InputError("not LAZ of bare points as puckbench writes it")
    check_points_of(count, stream)
    if not ((scale > 0) & (scale < _MOST_SCALE)).all():
        raise InputError("the stream is damaged (its scale)")
    return count, scale


def _check_chunks(stream: bytes, begin: int, chunks: int) -> None:
    """Refuse a table of more chunks than there are, for which lazrs would take memory."""
    (at,) = _CHUNKS_AT.unpack_from(stream, begin)
    if not begin < at <= len(stream) - _CHUNKS.size or _CHUNKS.unpack_from(stream, at)[1] != chunks:
        raise InputError("the stream is damaged (its table of chunks)")

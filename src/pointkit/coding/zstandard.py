"""Zstandard with a limit of the decompressed size."""

from __future__ import annotations

import sys

from pointkit.errors import InputError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

_WINDOW_LOG = 27
"""Log2 of the window of long-distance matches, in bytes; decoders' default maximum."""


def version() -> str:
    """Return the version of the library Zstandard, on which the bytes of frames depend."""
    return zstd.zstd_version


def compressed(
    data: bytes,
    level: int = 19,
    long: bool = False,
    *,
    has_checksum: bool = False,
    has_size: bool = True,
) -> bytes:
    """Return data compressed as one Zstandard frame.

    Parameters
    ----------
    data
        Bytes to compress.
    level
        Compression level of Zstandard, up to 22.
    long
        Whether repetitions are found at distances of up to 128 MiB.
    has_checksum, has_size
        Whether the frame states a checksum, and the number of bytes of its content.
    """
    options: dict[int, int] = {
        zstd.CompressionParameter.compression_level: level,
        zstd.CompressionParameter.checksum_flag: has_checksum,
        zstd.CompressionParameter.content_size_flag: has_size,
    }
    if long:
        options[zstd.CompressionParameter.enable_long_distance_matching] = 1
        options[zstd.CompressionParameter.window_log] = _WINDOW_LOG
    return zstd.compress(data, options=options)


def decompressed(stream: bytes, most: int) -> bytes:
    """Return the content of a Zstandard frame.

    Parameters
    ----------
    stream
        The frame.
    most
        Greatest number of bytes of the content.

    Raises
    ------
    InputError
        The frame is damaged, or its content is larger than `most`.
    """
    options: dict[int, int] = {zstd.DecompressionParameter.window_log_max: _WINDOW_LOG}
    decoder = zstd.ZstdDecompressor(options=options)
    try:
        data = decoder.decompress(stream, max_length=most + 1)
    except zstd.ZstdError as error:
        raise InputError("the stream is damaged (Zstandard)") from error
    if not decoder.eof or decoder.unused_data or len(data) > most:
        raise InputError("the stream is damaged (Zstandard)")
    return data

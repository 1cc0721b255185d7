"""General compressors of LiZIP's numbers: LZMA and zlib, as the authors' program calls them.

The program calls liblzma's encoder with threads, which writes sizes into the header of a block.
Python's module `lzma` has the encoder without threads, whose LZMA data are equal, as long as they
are in one block (192 MiB). The container around them is therefore written anew.
"""

from __future__ import annotations

import lzma
import struct
import zlib
from typing import Literal

from pointkit.coding.byte_io import Reader, base_128
from pointkit.errors import InputError

Compression = Literal["lzma", "zlib"]
NUMBERS: dict[Compression, int] = {"zlib": 1, "lzma": 2}
"""Numbers by which streams name compressors."""
_STORED = 0
_PRESET, _LEVEL = 9, 6
_MOST_MEMORY = 2**27
"""Maximum memory, in bytes, that a decoder of LZMA may use. Data that were compressed with preset 9
need half of it."""
_EDGE = 12
"""Bytes of the header, and of the footer, of an XZ file."""
_HEADER = 20
"""Bytes of a block's header that has sizes of up to 28 bits."""
_CHECK = 8
_SIZES_FOLLOW = 0xC0


def compressed(numbers: bytes, compression: Compression) -> bytes:
    """Compress bytes, at most 192 MiB, as the authors' program does.

    Parameters
    ----------
    numbers
        The bytes.
    compression
        ``lzma`` for an XZ file of preset 9, ``zlib`` for zlib's default level, 6.
    """
    if compression == "zlib":
        return zlib.compress(numbers, _LEVEL)
    return _with_sizes(lzma.compress(numbers, preset=_PRESET), len(numbers))


def decompressed(data: bytes, number: int, size: int) -> bytes:
    """Decompress bytes whose size is known.

    Parameters
    ----------
    data
        Compressed bytes.
    number
        Number of the compressor in streams; 0 for none.
    size
        Size of the result, which bounds the memory.

    Raises
    ------
    InputError
        If the data are damaged, or have another size.
    """
    if number == _STORED:
        result = data
    elif number == NUMBERS["zlib"]:
        result = _inflated(data, size)
    elif number == NUMBERS["lzma"]:
        result = _unpacked(data, size)
    else:
        raise InputError(f"the stream has compressor {number}; {{0, 1, 2}} are known")
    if len(result) != size:
        raise InputError("the stream is damaged (the size of its numbers)")
    return result


def _inflated(data: bytes, size: int) -> bytes:
    decoder = zlib.decompressobj()
    try:
        result = decoder.decompress(data, size + 1)
    except zlib.error as error:
        raise InputError("the stream is damaged (its zlib data)") from error
    return result if decoder.eof and not decoder.unused_data else b""


def _unpacked(data: bytes, size: int) -> bytes:
    decoder = lzma.LZMADecompressor(lzma.FORMAT_XZ, _MOST_MEMORY)
    try:
        result = decoder.decompress(data, size + 1)
    except (lzma.LZMAError, EOFError) as error:
        raise InputError("the stream is damaged (its LZMA data)") from error
    return result if decoder.eof and not decoder.unused_data else b""


def _with_sizes(file: bytes, size: int) -> bytes:
    """Write the sizes of an XZ file's only block, of `size` bytes, into the block's header."""
    footer = file[-_EDGE:]
    index_size = 4 * (struct.unpack_from("<I", footer, 4)[0] + 1)
    index = Reader(file[-_EDGE - index_size : -_EDGE])
    index.take(2)  # the mark of an index, and the number of blocks, 1
    unpadded = index.number()
    block = file[_EDGE : -_EDGE - index_size]
    old = 4 * (block[0] + 1)
    flags, filters = block[1], block[2:5]
    sizes = base_128(unpadded - old - _CHECK) + base_128(size)
    start = bytes([_HEADER // 4 - 1, flags | _SIZES_FOLLOW]) + sizes + filters
    header = _checked(start.ljust(_HEADER - 4, b"\0"))
    records = b"\0\1" + base_128(unpadded - old + _HEADER) + base_128(size)
    new_index = _checked(records + bytes(-len(records) % 4))
    end = struct.pack("<I", len(new_index) // 4 - 1) + footer[8:10]
    crc = struct.pack("<I", zlib.crc32(end))
    return file[:_EDGE] + header + block[old:] + new_index + crc + end + footer[10:]


def _checked(data: bytes) -> bytes:
    return data + struct.pack("<I", zlib.crc32(data))

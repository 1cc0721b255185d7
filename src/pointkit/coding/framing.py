"""Magic number, version and checksum before the body of a stream."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

from pointkit.errors import InputError

_CHECK = struct.Struct("<I")


@dataclass(frozen=True)
class Framing:
    """Format of a stream that starts with a magic number and has a checksum.

    A stream consists of the magic number, the version (1 byte), a header, the CRC-32 of the body (4
    bytes), and the body.

    Parameters
    ----------
    magic
        First bytes of every stream of the format.
    version
        0 to 255; streams of other versions are refused.
    title
        Name of the format in error messages.
    header
        Number of bytes of the header, which the CRC-32 does not cover.
    """

    magic: bytes
    version: int
    title: str
    header: int = 0

    @property
    def _start(self) -> bytes:
        return self.magic + bytes([self.version])

    def framed(self, body: bytes, header: bytes = b"") -> bytes:
        """Return a stream with the given body, and with a header of the format's header size."""
        return self._start + header + _CHECK.pack(zlib.crc32(body)) + body

    def unframed(self, stream: bytes) -> tuple[bytes, bytes]:
        """Check a stream, and return its header and its body.

        Raises
        ------
        InputError
            The magic number, the version or the checksum is wrong, or the stream is too short.
        """
        start, end = len(self._start), len(self._start) + self.header + _CHECK.size
        if len(stream) < end:
            raise InputError("the stream is truncated")
        if stream[:start] != self._start:
            raise InputError(f"not a {self.title} stream of this version")
        header, body = stream[start : start + self.header], stream[end:]
        if zlib.crc32(body) != _CHECK.unpack_from(stream, end - _CHECK.size)[0]:
            raise InputError("the stream is damaged or truncated")
        return header, body

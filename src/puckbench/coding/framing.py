"""The frame of a stream: magic and version of its codec, and a check of all that follows."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

from puckbench.core.errors import InputError

_CHECK = struct.Struct("<I")


@dataclass(frozen=True)
class Framing:
    """Magic, version, a header of few bytes that the codec chooses, CRC-32 of the body, body.

    Parameters
    ----------
    magic
        Four bytes that no other codec's streams begin with.
    version
        Of the stream's format, one byte.
    title
        What the codec is called in messages.
    header
        Bytes between version and check, which the check does not cover.
    """

    magic: bytes
    version: int
    title: str
    header: int = 0

    @property
    def _start(self) -> bytes:
        return self.magic + bytes([self.version])

    def framed(self, body: bytes, header: bytes = b"") -> bytes:
        """The stream of a body."""
        return self._start + header + _CHECK.pack(zlib.crc32(body)) + body

    def unframed(self, stream: bytes) -> tuple[bytes, bytes]:
        """Header and body of a stream.

        Raises
        ------
        InputError
            The stream is another codec's or another version's, damaged or truncated.
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

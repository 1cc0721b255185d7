"""Lossless codecs of the data packets of Velodyne sensors."""

from __future__ import annotations

import lzma
from abc import abstractmethod
from typing import ClassVar

from pointkit.coding.framing import Framing
from pointkit.coding.zstandard import compressed, decompressed
from pointkit.errors import InputError
from pointkit.lidar.returns import Returns
from puckbench import __version__
from puckbench.codecs.base import Pace, Parameters, lengths
from puckbench.codecs.registry import CODECS
from puckbench.codecs.returns_codec import ReturnsCodec
from puckbench.codecs.storage.packets import check_whole_packets, decode_packets, encode_packets

CODE = (
    *("puck.returns_header", "puck.recordings", "pointkit.lidar.sensors"),
    *("puckbench.codecs.returns_codec", "puckbench.codecs.storage.packets"),
)

_MEMORY_BYTES = 1 << 28
"""Maximum memory for LZMA's decompression; preset 9 has a dictionary of 64 MiB."""


class PacketsCodec(ReturnsCodec):
    """Base class of lossless codecs that compress a sensor's data packets as a whole.

    Reflectivities and times are compressed too. Virtual scans are refused: they have no
    reflectivities, so their packets would take fewer bytes than those of a real sensor.
    """

    metric_rates = lengths(2)
    any_length: ClassVar[bool] = False
    packets_alone: ClassVar[bool] = True
    pace = Pace(0.1, 4.0)
    line = ":"
    version = f"puckbench {__version__}"

    @abstractmethod
    def _packed(self, data: bytes) -> bytes: ...

    @abstractmethod
    def _unpacked(self, stream: bytes, most: int) -> bytes:
        """Decompress at most `most` bytes; raise InputError if data are longer or damaged."""

    @property
    def _framing(self) -> Framing:
        return Framing(self.magic, 1, self.title)

    def check_returns(self, returns: Returns) -> None:
        check_whole_packets(returns)

    def _encode_returns(self, returns: Returns, parameters: Parameters) -> bytes:
        return self._framing.framed(encode_packets(returns, self._packed))

    def _decode_returns(self, stream: bytes) -> Returns:
        return decode_packets(self._framing.unframed(stream)[1], self._unpacked)


@CODECS.register("packets_xz")
class PacketsXz(PacketsCodec):
    """The codec compresses data packets with all fields losslessly by LZMA (xz -9e)."""

    title = "Packets, xz (with reflectivity and time)"
    use = "captures as archives keep them; with reflectivities and times"
    colour = "#525252"
    marker = "4"
    rank = 190
    magic = b"PBPX"

    def _packed(self, data: bytes) -> bytes:
        return lzma.compress(data, preset=9 | lzma.PRESET_EXTREME)

    def _unpacked(self, stream: bytes, most: int) -> bytes:
        decoder = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=_MEMORY_BYTES)
        try:
            data = decoder.decompress(stream, max_length=most + 1)
        except (lzma.LZMAError, MemoryError) as error:
            raise InputError("the stream is damaged (LZMA)") from error
        if not decoder.eof or decoder.unused_data:
            raise InputError("the stream is damaged (LZMA)")
        return data


@CODECS.register("packets_zstd")
class PacketsZstd(PacketsCodec):
    """The codec compresses data packets with all fields losslessly by Zstandard (-19 --long)."""

    title = "Packets, Zstandard (with reflectivity and time)"
    use = "captures as MCAP files keep them, packed tighter; with reflectivities and times"
    colour = "#A0A0A0"
    marker = "|"
    rank = 180
    magic = b"PBPZ"

    def _packed(self, data: bytes) -> bytes:
        return compressed(data, long=True)

    def _unpacked(self, stream: bytes, most: int) -> bytes:
        return decompressed(stream, most)

"""Lossless codecs of the data packets of Velodyne sensors."""

from __future__ import annotations

import lzma
from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from pointkit.coding.framing import Framing
from pointkit.coding.zstandard import compressed, decompressed
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench import __version__
from puckbench.codecs.base import CloudKind
from puckbench.codecs.rates import Parameters
from puckbench.codecs.registry import CODECS
from puckbench.codecs.returns_codec import ReturnsCodec, cloud_of, returns_of
from puckbench.codecs.storage.packets import decode_packets, encode_packets

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

    rates: Mapping[str, Parameters] = {"2mm": {}}
    version = f"puckbench {__version__}"
    _format: ClassVar[str]

    @abstractmethod
    def _packed(self, data: bytes) -> bytes: ...

    @abstractmethod
    def _unpacked(self, stream: bytes, most: int) -> bytes:
        """Decompress at most `most` bytes; raise InputError if data are longer or damaged."""

    @property
    def _framing(self) -> Framing:
        return Framing(self.magic, 1, self._format)

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        is_virtual = cloud.has_returns and not cloud.has_packets
        return super().skip(cloud, rate) or ("codes recorded data packets" if is_virtual else None)

    def encode(self, cloud: PointCloud, rate: str, work: object = None) -> bytes:
        return self._framing.framed(encode_packets(returns_of(cloud), self._packed))

    def decode(self, stream: bytes) -> PointCloud:
        body = self._framing.unframed(stream)[1]
        return cloud_of(decode_packets(body, self._unpacked))


@CODECS.register("packets_xz")
class PacketsXz(PacketsCodec):
    """The codec compresses data packets with all fields losslessly by LZMA (xz -9e)."""

    magic = b"PBPX"
    _format = "xz packet"

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

    magic = b"PBPZ"
    _format = "Zstandard packet"

    def _packed(self, data: bytes) -> bytes:
        return compressed(data, long=True)

    def _unpacked(self, stream: bytes, most: int) -> bytes:
        return decompressed(stream, most)

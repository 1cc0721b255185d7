from __future__ import annotations

from puckbench import __version__
from puckbench.codecs.packets import PacketsCodec
from puckbench.codecs.registry import CODECS
from puckbench.coding.zstandard import compressed, decompressed


@CODECS.register("packets_zstd")
class PacketsZstd(PacketsCodec):
    """Data packets compressed losslessly, with every field, by Zstandard (zstd -19 --long)."""

    title = "Packets, Zstandard (with reflectivity and time)"
    use = "captures as MCAP files keep them, packed tighter; with reflectivities and times"
    colour = "#A0A0A0"
    marker = "|"
    rank = 180
    magic = b"PBPZ"
    version = f"puckbench {__version__}"

    def _packed(self, data: bytes) -> bytes:
        return compressed(data, long=True)

    def _unpacked(self, stream: bytes, most: int) -> bytes:
        return decompressed(stream, most)

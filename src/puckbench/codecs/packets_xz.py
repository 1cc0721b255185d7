from __future__ import annotations

import lzma

from puckbench import __version__
from puckbench.codecs.packets import PacketsCodec
from puckbench.codecs.registry import CODECS
from puckbench.core.errors import InputError

_MEMORY_BYTES = 1 << 28
"""Maximum memory for decompression; preset 9 has a dictionary of 64 MiB."""


@CODECS.register("packets_xz")
class PacketsXz(PacketsCodec):
    """Data packets compressed losslessly, with every field, by LZMA (xz -9e)."""

    title = "Packets, xz (with reflectivity and time)"
    use = "captures as archives keep them; with reflectivities and times"
    colour = "#525252"
    marker = "4"
    rank = 190
    magic = b"PBPX"
    version = f"puckbench {__version__}"

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

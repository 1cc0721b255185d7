"""Entropy coding and parts of stream formats, shared by several codecs.

Two functions code single bits with a binary arithmetic coder (`BitCoder`). `code` takes the
probability of the bit from its caller, and `code_bit` estimates the probability by context mixing.
Each of them encodes with a coder from `bit_writer` and decodes with a coder from `bit_reader`.

`base_128` and `signed_128` write whole numbers as bytes, and `Reader` reads these. `Framing` adds a
magic number, a version and a checksum to a stream. `compressed` and `decompressed` are Zstandard.
Damaged streams raise `pointkit.errors.InputError`.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from pointkit.coding.binary_coder import BitCoder as BitCoder
    from pointkit.coding.binary_coder import bit_reader as bit_reader
    from pointkit.coding.binary_coder import bit_writer as bit_writer
    from pointkit.coding.binary_coder import code as code
    from pointkit.coding.binary_coder import code_gamma as code_gamma
    from pointkit.coding.binary_coder import exhausted as exhausted
    from pointkit.coding.binary_coder import read_to_its_end as read_to_its_end
    from pointkit.coding.binary_coder import written as written
    from pointkit.coding.byte_io import Reader as Reader
    from pointkit.coding.byte_io import base_128 as base_128
    from pointkit.coding.byte_io import signed_128 as signed_128
    from pointkit.coding.context_mixing import Mixer as Mixer
    from pointkit.coding.context_mixing import MixerOptions as MixerOptions
    from pointkit.coding.context_mixing import code_bit as code_bit
    from pointkit.coding.context_mixing import new_mixer as new_mixer
    from pointkit.coding.framing import Framing as Framing
    from pointkit.coding.zstandard import compressed as compressed
    from pointkit.coding.zstandard import decompressed as decompressed

__getattr__, __dir__, __all__ = lazy(
    __name__,
    binary_coder=(
        "BitCoder",
        "bit_reader",
        "bit_writer",
        "code",
        "code_gamma",
        "exhausted",
        "read_to_its_end",
        "written",
    ),
    byte_io=("Reader", "base_128", "signed_128"),
    context_mixing=("Mixer", "MixerOptions", "code_bit", "new_mixer"),
    framing=("Framing",),
    zstandard=("compressed", "decompressed"),
)

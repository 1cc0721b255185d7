"""Number of set bits of a word, for compiled loops."""

from __future__ import annotations

from puckbench.core.compiling import inlined


@inlined
def bit_count(word: int) -> int:
    """Number of set bits of a 64-bit word, summed in pairs, fours and eights at once.

    LLVM knows the pattern and makes one instruction of it where the processor has one.
    """
    pairs = word - ((word >> 1) & 0x5555555555555555)
    fours = (pairs & 0x3333333333333333) + ((pairs >> 2) & 0x3333333333333333)
    eights = (fours + (fours >> 4)) & 0x0F0F0F0F0F0F0F0F
    return (eights * 0x0101010101010101) >> 56

"""Symbols to bytes: integer frequencies from logits, and constriction's range coder."""

from __future__ import annotations

from decimal import Decimal
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.octree_net.fixed import UNITS
from puckbench.codecs.octree_net.symbols import Symbols
from puckbench.errors import InputError

Logits = NDArray[np.float32]
Frequencies = NDArray[np.float32]
"""Whole numbers (n, 16)."""
_BITS = 16
_LEAST = 8
"""So that no symbol costs less than 0.0026 bits, which bounds what a byte can make."""
_WORD = 4


@cache
def _powers() -> Frequencies:
    """2**16 times 2**(-d / UNITS), rounded, for d = 0, 1, .. until `_LEAST` is left."""
    steps = range((_BITS - 3) * UNITS + 1)
    powers = [Decimal(2) ** (_BITS - Decimal(d) / UNITS) for d in steps]
    return np.array([round(power) for power in powers], dtype=np.float32)


def frequencies(logits: Logits) -> Frequencies:
    """Frequencies of symbols from their logits (n, 16), to the base 2, multiples of 1 / UNITS.

    The likeliest symbol has 65,536 and no symbol less than 8.
    """
    units = logits * np.float32(UNITS)
    below = (units.max(axis=1, keepdims=True) - units).astype(np.int32)
    powers = _powers()
    np.minimum(below, len(powers) - 1, out=below)
    return np.asarray(powers[below])


class SymbolEncoder:
    """Codes runs of symbols, one after the other."""

    def __init__(self) -> None:
        import constriction

        self._coder = constriction.stream.queue.RangeEncoder()

    def encode(self, symbols: Symbols, known: Frequencies) -> None:
        """Code symbols (n,), each with frequencies of its own."""
        self._coder.encode(symbols.astype(np.int32), _model(), known)

    def data(self) -> bytes:
        """All that was coded."""
        return bytes(self._coder.get_compressed().astype("<u4").tobytes())


class SymbolDecoder:
    """Reads back what an encoder made; InputError when the data are damaged."""

    def __init__(self, data: bytes) -> None:
        import constriction

        if len(data) % _WORD:
            raise InputError("the stream is damaged (symbols)")
        words = np.frombuffer(data, dtype="<u4").astype(np.uint32)
        self._coder = constriction.stream.queue.RangeDecoder(words)

    def decode(self, known: Frequencies) -> Symbols:
        """The next run, one symbol for each row of frequencies."""
        try:
            decoded = self._coder.decode(_model(), known)
        except (AssertionError, ValueError) as error:  # constriction's word for impossible data
            raise InputError("the stream is damaged (symbols)") from error
        symbols: Symbols = decoded.astype(np.uint8)
        return symbols

    def check_end(self) -> None:
        """InputError when more was coded than has been read."""
        if not self._coder.maybe_exhausted():
            raise InputError("the stream is damaged (symbols)")


def _model() -> Any:
    """Whole numbers below 2**24 have the same sums everywhere, and IEEE products the same bits."""
    import constriction

    return constriction.stream.model.Categorical(perfect=False)

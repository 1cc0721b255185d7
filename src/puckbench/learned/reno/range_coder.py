"""The range coder that the authors' program uses (torchac), for symbols with 16-bit frequencies.

References
----------
Witten, Neal, Cleary: "Arithmetic coding for data compression", CACM 1987; with 32 bits of precision
and the end of a stream as in torchac.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled
from puckbench.core.errors import InputError
from puckbench.learned.reno.layers import CDF_BITS, Cumulative, Symbols

Bytes = NDArray[np.uint8]
_MOST, _HALF, _QUARTER = 2**32 - 1, 2**31, 2**30


def encoded(symbols: Symbols, cumulative: Cumulative) -> bytes:
    """The bytes of symbols (n,), n >= 1, with cumulative frequencies (n, values + 1)."""
    into = np.zeros(3 * len(symbols) + 8, np.uint8)  # a symbol has at most some 16 bits
    return into[: _encode(symbols, cumulative, into)].tobytes()


def decoded(data: bytes, cumulative: Cumulative) -> Symbols:
    """The symbols (n,) of `encoded`; InputError when the data do not end with them."""
    symbols = np.empty(len(cumulative), np.uint8)
    if not _decode(np.frombuffer(data, np.uint8), cumulative, symbols):
        raise InputError("the stream is damaged (its symbols)")
    return symbols


@compiled
def _encode(symbols: Symbols, cumulative: Cumulative, into: Bytes) -> int:
    low, high, pending, at = 0, _MOST, 0, 0
    for row in range(len(symbols)):
        span = high - low + 1
        high = low - 1 + ((span * cumulative[row, symbols[row] + 1]) >> CDF_BITS)
        low = low + ((span * cumulative[row, symbols[row]]) >> CDF_BITS)
        while True:
            if high < _HALF or low >= _HALF:
                at = _written(into, at, int(low >= _HALF), pending)
                pending = 0
                low, high = 2 * low & _MOST, (2 * high & _MOST) | 1
            elif low >= _QUARTER and high < 3 * _QUARTER:
                pending += 1
                low, high = 2 * (low - _QUARTER), 2 * (high - _QUARTER) + 1
            else:
                break
    at = _written(into, at, int(low >= _QUARTER), pending + 1)
    return (at + 7) // 8


@compiled
def _written(into: Bytes, at: int, bit: int, pending: int) -> int:
    """Write a bit and as many of the other kind as were pending; where the next one goes."""
    into[at >> 3] |= bit << (7 - (at & 7))
    for k in range(at + 1, at + 1 + pending):
        into[k >> 3] |= (1 - bit) << (7 - (k & 7))
    return at + 1 + pending


@compiled
def _decode(data: Bytes, cumulative: Cumulative, symbols: Symbols) -> bool:
    bits = 8 * len(data)
    low, high, value, at = 0, _MOST, 0, 0
    while at < 32:
        value, at = 2 * value | _bit(data, at), at + 1
    for row in range(len(symbols)):
        span = high - low + 1
        count = ((value - low + 1 << CDF_BITS) - 1) // span
        symbol, above = 0, cumulative.shape[1] - 1
        while symbol + 1 < above:
            middle = (symbol + above) // 2
            if cumulative[row, middle] <= count:
                symbol = middle
            else:
                above = middle
        symbols[row] = symbol
        high = low - 1 + ((span * cumulative[row, symbol + 1]) >> CDF_BITS)
        low = low + ((span * cumulative[row, symbol]) >> CDF_BITS)
        while True:
            if high < _HALF or low >= _HALF:
                less = 0 if high < _HALF else _HALF
            elif low >= _QUARTER and high < 3 * _QUARTER:
                less = _QUARTER
            else:
                break
            low, high = 2 * (low - less), 2 * (high - less) + 1
            value, at = 2 * (value - less) | _bit(data, at), at + 1
        if at - 32 > bits:
            return False
    return (at - 32 + 2 + 7) // 8 == len(data)  # the encoder ends with two bits


@compiled
def _bit(data: Bytes, at: int) -> int:
    """A bit of the data, after whose end there are zeros."""
    return int(data[at >> 3]) >> (7 - (at & 7)) & 1 if at >> 3 < len(data) else 0

"""The range coder of the authors' program (torchac), for symbols with 16-bit frequencies.

The coder has 32 bits of precision, and ends streams as torchac does.

References
----------
Witten, Neal, Cleary: "Arithmetic coding for data compression", CACM 1987.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcc_networks.reno.inference import CDF_BITS, Cumulative, Symbols
from pointkit.compiling import compiled
from pointkit.errors import InputError

Bytes = NDArray[np.uint8]
_MAX, _HALF, _QUARTER = 2**32 - 1, 2**31, 2**30


def encode_symbols(symbols: Symbols, cumulative: Cumulative) -> bytes:
    """Encode symbols (n,) with cumulative frequencies (n, 17)."""
    out = np.zeros(3 * len(symbols) + 8, np.uint8)  # a symbol takes at most about 16 bits
    return out[: _encode(symbols, cumulative, out)].tobytes()


def decode_symbols(data: bytes, cumulative: Cumulative) -> Symbols:
    """Decode the symbols (n,) that were encoded with these cumulative frequencies (n, 17).

    Raises InputError if the data are damaged.
    """
    symbols = np.empty(len(cumulative), np.uint8)
    if not _decode(np.frombuffer(data, np.uint8), cumulative, symbols):
        raise InputError("the stream is damaged (its symbols)")
    return symbols


@compiled
def _encode(symbols: Symbols, cumulative: Cumulative, out: Bytes) -> int:
    low, high, pending, at = 0, _MAX, 0, 0
    for row in range(len(symbols)):
        span = high - low + 1
        high = low - 1 + ((span * cumulative[row, symbols[row] + 1]) >> CDF_BITS)
        low = low + ((span * cumulative[row, symbols[row]]) >> CDF_BITS)
        while True:
            if high < _HALF or low >= _HALF:
                at = _write_bits(out, at, int(low >= _HALF), pending)
                pending = 0
                low, high = 2 * low & _MAX, (2 * high & _MAX) | 1
            elif low >= _QUARTER and high < 3 * _QUARTER:
                pending += 1
                low, high = 2 * (low - _QUARTER), 2 * (high - _QUARTER) + 1
            else:
                break
    at = _write_bits(out, at, int(low >= _QUARTER), pending + 1)
    return (at + 7) // 8


@compiled
def _write_bits(out: Bytes, at: int, bit: int, pending: int) -> int:
    out[at >> 3] |= bit << (7 - (at & 7))
    for k in range(at + 1, at + 1 + pending):
        out[k >> 3] |= (1 - bit) << (7 - (k & 7))
    return at + 1 + pending


@compiled
def _decode(data: Bytes, cumulative: Cumulative, symbols: Symbols) -> bool:
    bits = 8 * len(data)
    low, high, value, at = 0, _MAX, 0, 0
    while at < 32:
        value, at = 2 * value | _bit(data, at), at + 1
    for row in range(len(symbols)):
        span = high - low + 1
        count = ((value - low + 1 << CDF_BITS) - 1) // span
        symbol, upper = 0, cumulative.shape[1] - 1
        while symbol + 1 < upper:
            middle = (symbol + upper) // 2
            if cumulative[row, middle] <= count:
                symbol = middle
            else:
                upper = middle
        symbols[row] = symbol
        high = low - 1 + ((span * cumulative[row, symbol + 1]) >> CDF_BITS)
        low = low + ((span * cumulative[row, symbol]) >> CDF_BITS)
        while True:
            if high < _HALF or low >= _HALF:
                subtracted = 0 if high < _HALF else _HALF
            elif low >= _QUARTER and high < 3 * _QUARTER:
                subtracted = _QUARTER
            else:
                break
            low, high = 2 * (low - subtracted), 2 * (high - subtracted) + 1
            value, at = 2 * (value - subtracted) | _bit(data, at), at + 1
        if at - 32 > bits:
            return False
    return (at - 32 + 2 + 7) // 8 == len(data)  # the encoder ends with two bits


@compiled
def _bit(data: Bytes, at: int) -> int:
    # the data continue with zeros
    return int(data[at >> 3]) >> (7 - (at & 7)) & 1 if at >> 3 < len(data) else 0

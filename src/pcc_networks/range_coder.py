"""The range coder of torchac, with which authors of learned codecs write symbols.

Frequencies of symbols are cumulative, and their total is 2^16. The coder has 32 bits of precision,
and ends streams as torchac does.

References
----------
Witten, Neal, Cleary: "Arithmetic coding for data compression", CACM 1987.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled, inlined
from pointkit.errors import InputError

Bytes = NDArray[np.uint8]
Symbols = NDArray[np.uint8]
Cumulative = NDArray[np.int32]
"""Cumulative frequencies (n, values + 1) of symbols: from 0 to 65,536, strictly increasing."""
CDF_BITS = 16
MAX_RANGE = 2**32 - 1
"""The interval of the coder is from 0 to this number before the first symbol."""
START_BITS = 32
"""Number of bits that a decoder reads before the first symbol."""
_HALF, _QUARTER = 2**31, 2**30
_END_BITS = 2


def encode_symbols(symbols: Symbols, cumulative: Cumulative) -> bytes:
    """Encode symbols (n,) with cumulative frequencies (n, values + 1)."""
    out = np.zeros(most_bytes(len(symbols)), np.uint8)
    return out[: _encode(symbols, cumulative, out)].tobytes()


def decode_symbols(data: bytes, cumulative: Cumulative) -> Symbols:
    """Decode the symbols (n,) that were encoded with these frequencies (n, values + 1).

    Raises InputError if the data are damaged.
    """
    symbols = np.empty(len(cumulative), np.uint8)
    check_end(data, _decode(np.frombuffer(data, np.uint8), cumulative, symbols))
    return symbols


def most_bytes(symbols: int) -> int:
    """Return how many bytes an encoder needs for a number of symbols, of about 16 bits at most."""
    return 3 * symbols + 8


def check_end(data: bytes, bits: int) -> None:
    """Raise InputError if the last symbol does not end with the data.

    Parameters
    ----------
    data
        The coded symbols.
    bits
        Number of bits that the decoder read, including the `START_BITS`.
    """
    if (bits - START_BITS + _END_BITS + 7) // 8 != len(data):
        raise InputError("the stream is damaged (its symbols)")


@inlined
def narrowed(low: int, high: int, first: int, end: int) -> tuple[int, int]:
    """Return the part of an interval that belongs to a symbol.

    Parameters
    ----------
    low, high
        The interval, both ends included.
    first, end
        Cumulative frequencies of the symbol and of the next.
    """
    span = high - low + 1
    return low + ((span * first) >> CDF_BITS), low - 1 + ((span * end) >> CDF_BITS)


@inlined
def position(low: int, high: int, value: int) -> int:
    """Return the cumulative frequency at which the decoder's value lies in the interval."""
    return ((value - low + 1 << CDF_BITS) - 1) // (high - low + 1)


@inlined
def settled_bits(
    out: Bytes, at: int, pending: int, low: int, high: int
) -> tuple[int, int, int, int]:
    """Write the bits that an interval settles, and return the state after them.

    Parameters
    ----------
    out
        Receives the bits.
    at
        Number of bits written so far.
    pending
        Number of bits that follow the next bit, and are opposite to it.
    low, high
        The interval.

    Returns
    -------
    tuple
        `at`, `pending`, `low` and `high`.
    """
    while True:
        if high < _HALF or low >= _HALF:
            at = _write_bits(out, at, int(low >= _HALF), pending)
            pending = 0
            low, high = 2 * low & MAX_RANGE, (2 * high & MAX_RANGE) | 1
        elif low >= _QUARTER and high < 3 * _QUARTER:
            pending += 1
            low, high = 2 * (low - _QUARTER), 2 * (high - _QUARTER) + 1
        else:
            return at, pending, low, high


@inlined
def read_settled(
    data: Bytes, at: int, value: int, low: int, high: int
) -> tuple[int, int, int, int]:
    """Read as many bits as an interval settles, and return the state after them.

    Parameters
    ----------
    data
        The coded symbols.
    at
        Number of bits read so far.
    value
        The last 32 bits that were read, less what intervals before have settled.
    low, high
        The interval.

    Returns
    -------
    tuple
        `at`, `value`, `low` and `high`.
    """
    while True:
        if high < _HALF or low >= _HALF:
            subtracted = 0 if high < _HALF else _HALF
        elif low >= _QUARTER and high < 3 * _QUARTER:
            subtracted = _QUARTER
        else:
            return at, value, low, high
        low, high = 2 * (low - subtracted), 2 * (high - subtracted) + 1
        value, at = 2 * (value - subtracted) | _bit(data, at), at + 1


@compiled
def end_of_bits(out: Bytes, at: int, pending: int, low: int) -> int:
    """Write the last bits, and return the number of bytes; arguments are as in `settled_bits`."""
    return (_write_bits(out, at, int(low >= _QUARTER), pending + 1) + 7) // 8


@compiled
def first_value(data: Bytes) -> int:
    """Return the first `START_BITS` bits of coded symbols, as a number."""
    value = 0
    for at in range(START_BITS):
        value = 2 * value | _bit(data, at)
    return value


@compiled
def _encode(symbols: Symbols, cumulative: Cumulative, out: Bytes) -> int:
    low, high, pending, at = 0, MAX_RANGE, 0, 0
    for row in range(len(symbols)):
        symbol = symbols[row]
        low, high = narrowed(low, high, cumulative[row, symbol], cumulative[row, symbol + 1])
        at, pending, low, high = settled_bits(out, at, pending, low, high)
    return end_of_bits(out, at, pending, low)


@compiled
def _write_bits(out: Bytes, at: int, bit: int, pending: int) -> int:
    out[at >> 3] |= bit << (7 - (at & 7))
    for k in range(at + 1, at + 1 + pending):
        out[k >> 3] |= (1 - bit) << (7 - (k & 7))
    return at + 1 + pending


@compiled
def _decode(data: Bytes, cumulative: Cumulative, symbols: Symbols) -> int:
    low, high, value, at = 0, MAX_RANGE, first_value(data), START_BITS
    for row in range(len(symbols)):
        if at - START_BITS > 8 * len(data):
            break
        count = position(low, high, value)
        symbol, upper = 0, cumulative.shape[1] - 1
        while symbol + 1 < upper:
            middle = (symbol + upper) // 2
            if cumulative[row, middle] <= count:
                symbol = middle
            else:
                upper = middle
        symbols[row] = symbol
        low, high = narrowed(low, high, cumulative[row, symbol], cumulative[row, symbol + 1])
        at, value, low, high = read_settled(data, at, value, low, high)
    return at


@compiled
def _bit(data: Bytes, at: int) -> int:
    # the data continue with zeros
    return int(data[at >> 3]) >> (7 - (at & 7)) & 1 if at >> 3 < len(data) else 0

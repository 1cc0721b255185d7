"""Binary arithmetic coder in 32-bit integers, so that all machines decode identically.

The same function, `code`, encodes and decodes. With a coder from `bit_writer`, it encodes its
argument `bit`; with a coder from `bit_reader`, it ignores this argument and returns the decoded
bit.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled_in_place, inlined, inlined_too

ONE = 1 << 16
"""The probability 1, in fixed point."""
LOGIT_UNIT = 256
"""The natural logit 1, in fixed point."""
LOGIT_LIMIT = 8 * LOGIT_UNIT
"""Logits are clipped to plus and minus this value."""
MIN_PROBABILITY = 32
"""Minimum probability of a bit's value; such a value costs 11 bits, the opposite 0.0007 bits."""
MAX_MEMORY = 160
"""Largest number of coded bits after which a probability adapts at a constant rate."""
_TOP = (1 << 32) - 1
_TAIL = 4
PAST_THE_END = 8
"""Maximum number of trailing zero bytes that `written` removes and a reader supplies."""

LOW, HIGH, CODE, POSITION, WRITING = range(5)
"""Indices of a coder's registers."""


class BitCoder(NamedTuple):
    """State of an arithmetic coder: `bit_writer` makes an encoder, `bit_reader` a decoder.

    Parameters
    ----------
    registers
        Five integers: lower end and upper end of the interval, decoded word, position in the
        buffer, and 1 for an encoder or 0 for a decoder.
    buffer
        The bytes of the stream, (n,).
    """

    registers: NDArray[np.int64]  # (5,)
    buffer: NDArray[np.uint8]  # (n,), the bytes of the stream


def bit_writer(most_bytes: int) -> BitCoder:
    """Return an encoder, which writes to a buffer of fixed size.

    Parameters
    ----------
    most_bytes
        Size of the buffer. Compiled code does not check this limit: provide two bytes for each bit
        that is coded with `code` or `code_bit`, and 64 more.

    Returns
    -------
    BitCoder
        The encoder; `written` returns its bytes.
    """
    registers = np.array([0, _TOP, 0, 0, 1], np.int64)
    return BitCoder(registers, np.empty(most_bytes, np.uint8))


def bit_reader(stream: bytes) -> BitCoder:
    """Return a decoder.

    Parameters
    ----------
    stream
        Bytes that `written` returned. The decoder reads zeros beyond their end.

    Returns
    -------
    BitCoder
        The decoder.
    """
    start = stream[:_TAIL].ljust(_TAIL, b"\0")
    registers = np.array([0, _TOP, int.from_bytes(start, "big"), _TAIL, 0], np.int64)
    return BitCoder(registers, np.frombuffer(stream, np.uint8).copy())


def written(coder: BitCoder) -> bytes:
    """Finish encoding, and return the bytes of the stream.

    Up to `PAST_THE_END` zero bytes at the end are left out, since a decoder reads zeros there.
    """
    registers = coder.registers
    tail = (int(registers[LOW]) + (1 << 24) - 1) >> 24 << 24
    if tail > registers[HIGH]:
        tail = int(registers[HIGH])
    body = coder.buffer[: registers[POSITION]].tobytes() + tail.to_bytes(_TAIL, "big")
    kept = max(len(body.rstrip(b"\0")), len(body) - PAST_THE_END)
    return body[:kept]


def read_to_its_end(coder: BitCoder) -> bool:
    """Return whether a decoder has read exactly the bytes that the encoder wrote."""
    return 0 <= int(coder.registers[POSITION]) - len(coder.buffer) <= PAST_THE_END


@compiled_in_place
def exhausted(coder: BitCoder) -> bool:
    """Return whether a decoder has read so far past the end that its stream must be damaged.

    The result is always False for an encoder.
    """
    registers = coder.registers
    past = registers[POSITION] > len(coder.buffer) + PAST_THE_END
    return bool(registers[WRITING] == 0 and past)


@cache
def logistic_tables() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return lookup tables that convert between probabilities and logits.

    Returns
    -------
    stretch, squash
        Table (4096,) from probabilities in units of 1 / 4096 to logits; and table (2 *
        LOGIT_LIMIT,) from logits plus LOGIT_LIMIT to probabilities in units of 1 / ONE.
    """
    probabilities = (np.arange(4096) + 0.5) / 4096
    stretch = np.rint(LOGIT_UNIT * np.log(probabilities / (1 - probabilities))).astype(np.int64)
    squash = np.rint(ONE / (1 + np.exp(-np.arange(-LOGIT_LIMIT, LOGIT_LIMIT) / LOGIT_UNIT))).astype(
        np.int64
    )
    return stretch.clip(-LOGIT_LIMIT, LOGIT_LIMIT - 1), squash.clip(
        MIN_PROBABILITY, ONE - MIN_PROBABILITY
    )


def learning_rates() -> NDArray[np.int64]:
    """Return adaptation rates by the number of coded bits, (MAX_MEMORY + 1,).

    The rates are in units of 1 / ONE.
    """
    return np.rint(ONE / (np.arange(MAX_MEMORY + 1) + 1.6)).astype(np.int64)


@inlined_too
def code(coder: BitCoder, bit: int, probability: int) -> int:
    """Encode or decode one bit, and return the bit.

    Parameters
    ----------
    coder
        From `bit_writer` to encode, or from `bit_reader` to decode.
    bit
        The bit to encode, 0 or 1; ignored when decoding.
    probability
        Probability that the bit is 1, in units of 1 / ONE, from 1 to ONE - 1. Encoder and decoder
        must use the same value.

    Returns
    -------
    int
        The bit that was encoded or decoded.
    """
    registers = coder.registers
    low, high = registers[0], registers[1]
    width = high - low
    middle = low + (width >> 16) * probability + (((width & 0xFFFF) * probability) >> 16)
    if registers[4] == 0:
        bit = int(registers[2] <= middle)
    # Without branches, since bits are unpredictable.
    high += (middle - high) & -bit
    low += (middle + 1 - low) & (bit - 1)
    _normalise(coder, low, high)
    return bit


@inlined
def code_uniform(coder: BitCoder, number: int, count: int) -> int:
    """Encode or decode a number from 0 to count - 1, all equally likely, and return the number.

    Parameters
    ----------
    coder
        From `bit_writer` to encode, or from `bit_reader` to decode.
    number
        The number to encode; ignored when decoding.
    count
        Number of possible values, at most 2^16.

    Returns
    -------
    int
        The number that was encoded or decoded.
    """
    registers = coder.registers
    low, high = registers[0], registers[1]
    part = (high - low) // count
    if part < 256:  # too inexact, and maybe 0
        return _code_halves(coder, number, count)
    if registers[4] == 0:
        number = min(max((registers[2] - low) // part, 0), count - 1)
    low += part * number
    _normalise(coder, low, low + part - 1)
    return number


@inlined
def _code_halves(coder: BitCoder, number: int, count: int) -> int:
    low, high = 0, count
    while high - low > 1:
        middle = (low + high) >> 1
        bit = code(coder, int(number >= middle), ONE // 2)
        low, high = (middle, high) if bit == 1 else (low, middle)
    return low


@inlined
def _normalise(coder: BitCoder, low: int, high: int) -> None:
    registers = coder.registers
    while (low ^ high) >> 24 == 0:
        if registers[4] == 1:
            coder.buffer[registers[3]] = high >> 24
            registers[3] += 1
        else:
            registers[2] = ((registers[2] << 8) & 0xFFFFFFFF) | _next_byte(coder)
        low = (low << 8) & 0xFFFFFFFF
        high = ((high << 8) & 0xFFFFFFFF) | 255
    registers[0], registers[1] = low, high


@inlined
def _next_byte(coder: BitCoder) -> int:
    position = coder.registers[3]
    coder.registers[3] = position + 1
    return int(coder.buffer[position]) if position < len(coder.buffer) else 0


@compiled_in_place
def code_gamma(coder: BitCoder, value: int) -> int:
    """Encode or decode a number in Elias gamma code, and return the number.

    The code of a number n has about 2 log2(n) + 1 bits.

    Parameters
    ----------
    coder
        From `bit_writer` to encode, or from `bit_reader` to decode.
    value
        The number to encode, from 1 to 2^17 - 1; ignored when decoding.

    Returns
    -------
    int
        The number that was encoded or decoded.
    """
    bits = 0
    if coder.registers[WRITING] == 1:
        while value >> (bits + 1):
            bits += 1
    length = 0
    while length < 16 and code(coder, 1 if length < bits else 0, ONE // 2) == 1:
        length += 1
    number = 1
    for k in range(length - 1, -1, -1):
        number = (number << 1) | code(coder, (value >> k) & 1, ONE // 2)
    return number

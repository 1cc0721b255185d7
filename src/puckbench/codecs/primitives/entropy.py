"""Adaptive binary arithmetic coding: each bit's probability is mixed from several contexts.

A context's own estimate is an adaptive probability; the estimates are mixed in the logistic domain
by weights that are learnt on the way (Mahoney 2005, "Adaptive weighing of context models for
lossless data compression"). All arithmetic is on integers, so that every machine decodes the same.
One function codes both ways: it writes the bit it is given, or reads one and returns it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.compiling import compiled

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

ONE = 1 << 16
"""Probability 1 in fixed point."""
UNIT = 256
"""1.0 of the logistic domain in fixed point; it ends at +-8."""
_SLOWEST = 160
_RATE = 14
_TOP = (1 << 32) - 1
PAST_THE_END = 8
"""Zeros that `written` leaves out, at most; a reader that goes further has a damaged stream."""

LOW, HIGH, CODE, POSITION, WRITING = range(5)
"""Places in a coder's registers."""


class Coder(NamedTuple):
    """State of a coder: registers, bytes, and what it has learnt.

    chances, seen: (contexts,) probability of a 1 and number of bits seen. weights: (mixers, 3).
    stretch, squash, rates: tables.
    """

    registers: Ints
    buffer: Bytes
    chances: Ints
    seen: Ints
    weights: Ints
    stretch: Ints
    squash: Ints
    rates: Ints


def writer(contexts: int, mixers: int, most_bytes: int) -> Coder:
    """A coder that writes at most `most_bytes` bytes."""
    return _coder(np.zeros(most_bytes, np.uint8), contexts, mixers, writing=True)


def reader(stream: bytes, contexts: int, mixers: int) -> Coder:
    """A coder that reads a stream; past its end it reads zeros."""
    coder = _coder(np.frombuffer(stream, np.uint8).copy(), contexts, mixers, writing=False)
    for _ in range(4):
        coder.registers[CODE] = (coder.registers[CODE] << 8) | _next_byte(coder)
    return coder


def written(coder: Coder) -> bytes:
    """The bytes written, the last ones flushed; some zeros at their end are left out."""
    registers = coder.registers
    tail = (int(registers[LOW]) + (1 << 24) - 1) >> 24 << 24
    if tail > registers[HIGH]:
        tail = int(registers[HIGH])
    body = coder.buffer[: registers[POSITION]].tobytes() + tail.to_bytes(4, "big")
    kept = max(len(body.rstrip(b"\0")), len(body) - PAST_THE_END)
    return body[:kept]


def _coder(buffer: Bytes, contexts: int, mixers: int, writing: bool) -> Coder:
    steps = np.arange(-8 * UNIT, 8 * UNIT) / UNIT
    squash = np.rint(ONE / (1 + np.exp(-steps))).astype(np.int64)
    chances = (np.arange(4096) + 0.5) / 4096
    stretch = np.rint(UNIT * np.log(chances / (1 - chances))).astype(np.int64)
    return Coder(
        np.array([0, _TOP, 0, 0, int(writing)], np.int64),
        buffer,
        np.full(contexts, ONE // 2, np.int64),
        np.zeros(contexts, np.int64),
        np.full((mixers, 3), int(0.4 * ONE), np.int64),
        stretch.clip(-8 * UNIT, 8 * UNIT - 1),
        squash.clip(32, ONE - 32),
        np.rint(ONE / (np.arange(_SLOWEST + 1) + 1.6)).astype(np.int64),
    )


@compiled
def code_bit(coder: Coder, bit: int, mixer: int, contexts: tuple[int, int, int]) -> int:
    """Code a bit in three contexts, mixed by the weights of `mixer`; the bit."""
    a, b, c = contexts
    weights, stretch = coder.weights[mixer], coder.stretch
    s_a = stretch[coder.chances[a] >> 4]
    s_b = stretch[coder.chances[b] >> 4]
    s_c = stretch[coder.chances[c] >> 4]
    mixed = (weights[0] * s_a + weights[1] * s_b + weights[2] * s_c) >> 16
    chance = coder.squash[min(max(mixed, -8 * UNIT), 8 * UNIT - 1) + 8 * UNIT]
    bit = _code(coder, bit, chance)
    error = (bit * ONE - chance) * _RATE
    weights[0] += (s_a * error + (1 << 17)) >> 18
    weights[1] += (s_b * error + (1 << 17)) >> 18
    weights[2] += (s_c * error + (1 << 17)) >> 18
    _learn(coder, a, bit)
    _learn(coder, b, bit)
    _learn(coder, c, bit)
    return bit


@compiled
def _learn(coder: Coder, context: int, bit: int) -> None:
    seen = coder.seen[context]
    coder.chances[context] += ((bit * 65535 - coder.chances[context]) * coder.rates[seen]) >> 16
    if seen < 160:
        coder.seen[context] = seen + 1


@compiled
def _code(coder: Coder, bit: int, chance: int) -> int:
    """Arithmetic coding of one bit that is 1 with probability chance / ONE."""
    registers = coder.registers
    low, high = registers[0], registers[1]
    middle = low + ((high - low) >> 16) * chance + ((((high - low) & 0xFFFF) * chance) >> 16)
    if registers[4] == 0:
        bit = 1 if registers[2] <= middle else 0
    if bit == 1:
        high = middle
    else:
        low = middle + 1
    while (low ^ high) >> 24 == 0:
        if registers[4] == 1:
            coder.buffer[registers[3]] = high >> 24
            registers[3] += 1
        else:
            registers[2] = ((registers[2] << 8) & 0xFFFFFFFF) | _next_byte(coder)
        low = (low << 8) & 0xFFFFFFFF
        high = ((high << 8) & 0xFFFFFFFF) | 255
    registers[0], registers[1] = low, high
    return bit


@compiled
def _next_byte(coder: Coder) -> int:
    position = coder.registers[3]
    coder.registers[3] = position + 1
    return int(coder.buffer[position]) if position < len(coder.buffer) else 0


@compiled
def code_number(coder: Coder, value: int, mixer: int, base: int, base_b: int) -> int:
    """Code a signed whole number, small ones cheaply; `base`, `base_b`: 40 contexts from each on.

    Zero or not, sign, then the magnitude: unary up to 12, the rest in Elias-gamma code.
    """
    if code_bit(coder, 1 if value == 0 else 0, mixer, (base, base_b, base)) == 1:
        return 0
    contexts = (base + 1, base_b + 1, base + 1)
    negative = code_bit(coder, 1 if value < 0 else 0, mixer + 1, contexts)
    magnitude = abs(value)
    for k in range(1, 13):
        contexts = (base + 1 + k, base_b + 1 + k, base + 1 + k)
        if code_bit(coder, 1 if magnitude > k else 0, mixer + 2, contexts) == 0:
            return -k if negative == 1 else k
    rest = 12 + _code_gamma(coder, magnitude - 12)
    return -rest if negative == 1 else rest


@compiled
def _code_gamma(coder: Coder, value: int) -> int:
    """Elias-gamma code of a number of at least 1 (below 2^16)."""
    bits = 0
    if coder.registers[4] == 1:
        while value >> (bits + 1):
            bits += 1
    length = 0
    while length < 16 and _code(coder, 1 if length < bits else 0, 32768) == 1:
        length += 1
    found = 1
    for k in range(length - 1, -1, -1):
        found = (found << 1) | _code(coder, (value >> k) & 1, 32768)
    return found

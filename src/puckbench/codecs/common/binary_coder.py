"""Binary arithmetic coding, both ways: a bit and its probability to bytes, and back.

All arithmetic is on integers, so that every machine decodes the same. One function codes both ways:
it writes the bit it is given, or reads one and returns it.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled_in_place

ONE = 1 << 16
"""Probability 1 in fixed point."""
UNIT = 256
"""1.0 of the logistic domain in fixed point."""
ENDS = 8 * UNIT
"""Logits are kept between these."""
LEAST = 32
"""Probability of a mixture, at least: no bit of one costs less than 0.0007 bits."""
SLOWEST = 160
"""An adaptive probability follows its last so many bits."""
_TOP = (1 << 32) - 1
_TAIL = 4
PAST_THE_END = 8
"""Zeros that `written` leaves out, at most; a reader that goes further has a damaged stream."""

LOW, HIGH, CODE, POSITION, WRITING = range(5)
"""Places in a coder's registers."""


class BitCoder(NamedTuple):
    """State of a coder, for `code`."""

    registers: NDArray[np.int64]
    buffer: NDArray[np.uint8]


def bit_writer(most_bytes: int) -> BitCoder:
    """A coder that writes at most `most_bytes` bytes."""
    registers = np.array([0, _TOP, 0, 0, 1], np.int64)
    return BitCoder(registers, np.zeros(most_bytes, np.uint8))


def bit_reader(stream: bytes) -> BitCoder:
    """A coder that reads a stream; past its end it reads zeros."""
    start = stream[:_TAIL].ljust(_TAIL, b"\0")
    registers = np.array([0, _TOP, int.from_bytes(start, "big"), _TAIL, 0], np.int64)
    return BitCoder(registers, np.frombuffer(stream, np.uint8).copy())


def written(coder: BitCoder) -> bytes:
    """The bytes written, the last ones flushed; some zeros at their end are left out."""
    registers = coder.registers
    tail = (int(registers[LOW]) + (1 << 24) - 1) >> 24 << 24
    if tail > registers[HIGH]:
        tail = int(registers[HIGH])
    body = coder.buffer[: registers[POSITION]].tobytes() + tail.to_bytes(_TAIL, "big")
    kept = max(len(body.rstrip(b"\0")), len(body) - PAST_THE_END)
    return body[:kept]


def read_to_its_end(coder: BitCoder) -> bool:
    """Whether a reader has read what a writer wrote, no less and no more."""
    return 0 <= int(coder.registers[POSITION]) - len(coder.buffer) <= PAST_THE_END


@cache
def logistic_tables() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of probabilities in 1 / 4096 their logits, and of logits the probabilities in 1 / ONE."""
    chances = (np.arange(4096) + 0.5) / 4096
    stretch = np.rint(UNIT * np.log(chances / (1 - chances))).astype(np.int64)
    squash = np.rint(ONE / (1 + np.exp(-np.arange(-ENDS, ENDS) / UNIT))).astype(np.int64)
    return stretch.clip(-ENDS, ENDS - 1), squash.clip(LEAST, ONE - LEAST)


def learning_rates() -> NDArray[np.int64]:
    """How far, in 1 / ONE, a probability moves to a bit after so many bits, (SLOWEST + 1,)."""
    return np.rint(ONE / (np.arange(SLOWEST + 1) + 1.6)).astype(np.int64)


@compiled_in_place
def code(coder: BitCoder, bit: int, chance: int) -> int:
    """Code a bit that is 1 with probability chance / ONE, 0 < chance < ONE; the bit."""
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


@compiled_in_place
def _next_byte(coder: BitCoder) -> int:
    position = coder.registers[3]
    coder.registers[3] = position + 1
    return int(coder.buffer[position]) if position < len(coder.buffer) else 0


@compiled_in_place
def code_gamma(coder: BitCoder, value: int) -> int:
    """Elias-gamma code of a number of at least 1 (below 2^16)."""
    bits = 0
    if coder.registers[WRITING] == 1:
        while value >> (bits + 1):
            bits += 1
    length = 0
    while length < 16 and code(coder, 1 if length < bits else 0, ONE // 2) == 1:
        length += 1
    found = 1
    for k in range(length - 1, -1, -1):
        found = (found << 1) | code(coder, (value >> k) & 1, ONE // 2)
    return found

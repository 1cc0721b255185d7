"""Binary arithmetic coder: codes bits with given probabilities, in 32-bit integer arithmetic.

Integers make every machine decode the same. One function, `code`, serves both directions: a writer
codes the bit that it is given, a reader returns the bit that it decodes.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled_in_place, inlined, inlined_too

ONE = 1 << 16
"""Probability 1 in fixed point."""
UNIT = 256
"""1.0 of the logistic domain (a logit, ln(p / (1 - p))) in fixed point."""
ENDS = 8 * UNIT
"""Logits are clipped to plus and minus this."""
LEAST = 32
"""Smallest probability that is coded: no bit costs less than 0.0007 bits."""
SLOWEST = 160
"""Longest memory of an adaptive probability, in bits."""
_TOP = (1 << 32) - 1
_TAIL = 4
PAST_THE_END = 8
"""Most zero bytes that `written` leaves out; a reader that goes further has a damaged stream."""

LOW, HIGH, CODE, POSITION, WRITING = range(5)
"""Indices of a coder's registers."""


class BitCoder(NamedTuple):
    """State of a coder: its registers (5,) int64 and the stream's bytes (n,) uint8."""

    registers: NDArray[np.int64]
    buffer: NDArray[np.uint8]


def bit_writer(most_bytes: int) -> BitCoder:
    """A coder that writes at most `most_bytes` bytes."""
    registers = np.array([0, _TOP, 0, 0, 1], np.int64)
    return BitCoder(registers, np.empty(most_bytes, np.uint8))


def bit_reader(stream: bytes) -> BitCoder:
    """A coder that reads a stream; past its end it reads zeros."""
    start = stream[:_TAIL].ljust(_TAIL, b"\0")
    registers = np.array([0, _TOP, int.from_bytes(start, "big"), _TAIL, 0], np.int64)
    return BitCoder(registers, np.frombuffer(stream, np.uint8).copy())


def written(coder: BitCoder) -> bytes:
    """Flush a writer and return its bytes, but for zeros at their end, which a reader adds."""
    registers = coder.registers
    tail = (int(registers[LOW]) + (1 << 24) - 1) >> 24 << 24
    if tail > registers[HIGH]:
        tail = int(registers[HIGH])
    body = coder.buffer[: registers[POSITION]].tobytes() + tail.to_bytes(_TAIL, "big")
    kept = max(len(body.rstrip(b"\0")), len(body) - PAST_THE_END)
    return body[:kept]


def read_to_its_end(coder: BitCoder) -> bool:
    """Whether a reader has read exactly what a writer wrote."""
    return 0 <= int(coder.registers[POSITION]) - len(coder.buffer) <= PAST_THE_END


@compiled_in_place
def exhausted(coder: BitCoder) -> bool:
    """Whether a reader has gone further than any stream of its length lets it."""
    registers = coder.registers
    past = registers[POSITION] > len(coder.buffer) + PAST_THE_END
    return bool(registers[WRITING] == 0 and past)


@cache
def logistic_tables() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Tables ``stretch`` (4096,), probability to logit, and ``squash`` (2 ENDS,), its inverse.

    Probabilities are in units of 1 / 4096 on the way there and of 1 / ONE on the way back.
    """
    probabilities = (np.arange(4096) + 0.5) / 4096
    stretch = np.rint(UNIT * np.log(probabilities / (1 - probabilities))).astype(np.int64)
    squash = np.rint(ONE / (1 + np.exp(-np.arange(-ENDS, ENDS) / UNIT))).astype(np.int64)
    return stretch.clip(-ENDS, ENDS - 1), squash.clip(LEAST, ONE - LEAST)


def learning_rates() -> NDArray[np.int64]:
    """Learning rates, in 1 / ONE, of adaptive probabilities by bits seen, (SLOWEST + 1,)."""
    return np.rint(ONE / (np.arange(SLOWEST + 1) + 1.6)).astype(np.int64)


@inlined_too
def code(coder: BitCoder, bit: int, probability: int) -> int:
    """Code a bit that is 1 with probability / ONE, strictly between 0 and 1; returns the bit."""
    registers = coder.registers
    low, high = registers[0], registers[1]
    width = high - low
    middle = low + (width >> 16) * probability + (((width & 0xFFFF) * probability) >> 16)
    if registers[4] == 0:
        bit = int(registers[2] <= middle)
    # No branches: what a bit is cannot be foreseen.
    high += (middle - high) & -bit
    low += (middle + 1 - low) & (bit - 1)
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


@inlined
def _next_byte(coder: BitCoder) -> int:
    position = coder.registers[3]
    coder.registers[3] = position + 1
    return int(coder.buffer[position]) if position < len(coder.buffer) else 0


@compiled_in_place
def code_gamma(coder: BitCoder, value: int) -> int:
    """Elias-gamma code of a number of at least 1 (below 2^16); returns the number."""
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

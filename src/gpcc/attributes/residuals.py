"""Arithmetic coding of quantised coefficients as runs of zeros, magnitudes and signs.

In TMC13: `PCCResidualsEncoder`, `PCCResidualsDecoder`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpcc.arithmetic import (
    HALF,
    Bytes,
    Probabilities,
    code_bit,
    code_bypass,
    code_exp_golomb,
    code_exp_golomb_in_contexts,
    consumed,
    decoder,
    encoder,
    enlarged,
    exhausted,
    finish,
)
from gpcc.compiled import entry, integer, kernel
from pointkit.compiling import inlined
from pointkit.errors import InputError

Coefficients = NDArray[np.int32]

# Indices into probabilities; a comment states the number of contexts.
_RUN = integer(0)  # 5
_GREATER_THAN_0 = integer(5)  # 7
_GREATER_THAN_1 = integer(12)  # 7
_PREFIX = integer(19)  # 2 x 3
_SUFFIX = integer(25)  # 2 x 3
_COUNT = 31

_COEFFICIENT_BYTES = 48
"""Maximum number of bytes of a point's coefficients."""
_CHUNK = 1 << 16


def initial_probabilities() -> Probabilities:
    return np.full(_COUNT, HALF, dtype=np.uint16)


def decode_coefficients(
    data: Bytes, bypass: Bytes | None, contexts: Probabilities, count: int, components: int
) -> Coefficients:
    """Decode quantised coefficients (count, components), and return them.

    Parameters
    ----------
    data
        Arithmetic-coded bytes.
    bypass
        Bypass bits, one in each byte, if the stream holds them separately; otherwise None.
    contexts
        Probabilities, which the decoding adapts.
    count, components
        Number of points, and number of components of a value.

    Raises
    ------
    InputError
        The data are damaged or truncated.
    """
    coder = decoder(contexts, data, bypass)
    values = np.zeros((count, components), dtype=np.int32)
    done = _code_coefficients(coder, values, 0, count, False)
    if done < 0 or consumed(coder) > coder.state[4]:
        raise InputError("G-PCC stream: the values of an attribute are damaged or truncated")
    return values


def encode_coefficients(values: Coefficients, contexts: Probabilities) -> bytes:
    coder, done = encoder(contexts, 64), 0
    while done < len(values):
        coder = enlarged(coder, _COEFFICIENT_BYTES * _CHUNK)
        end = min(done + _CHUNK, len(values))
        done = _code_coefficients(coder, values, done, end, True)
    return finish(coder)


@entry
def _code_coefficients(coder: Any, values: Coefficients, i: int, end: int, encoding: bool) -> int:
    """Code the coefficients of points `i` to `end` - 1, and what is left of a run of zeros."""
    # Returns the next point, or -1 if the stream is too short.
    count, components = values.shape
    while i < end:
        run = integer(0)
        if encoding:
            while i + run < count and _is_zero(values, i + run):
                run += 1
        i += _code_run(coder, run)
        if i < count:
            if components == 1:
                _code_single(coder, values, i)
            else:
                _code_triple(coder, values, i)
        i += 1
        if exhausted(coder):
            return -1
    return i


@inlined
def _is_zero(values: Coefficients, i: int) -> bool:
    zero = True
    for k in range(values.shape[1]):
        zero = zero and values[i, k] == 0
    return zero


@inlined
def _code_run(coder: Any, run: int) -> int:
    for short in range(3):
        if not code_bit(coder, _RUN + short, integer(run > short)):
            return short
    for pairs in range(4):
        value = 3 + 2 * pairs
        if not code_bit(coder, _RUN + 3, integer(run >= value + 2)):
            return value + code_bypass(coder, (run - value) & 1)
    return 11 + code_exp_golomb(coder, _RUN + 4, run - 11, 2)


@kernel
def _code_magnitude(coder: Any, value: int, first: int, second: int, rest: int) -> int:
    if not code_bit(coder, _GREATER_THAN_0 + first, integer(value > 0)):
        return 0
    if not code_bit(coder, _GREATER_THAN_1 + second, integer(value > 1)):
        return 1
    prefix, suffix = _PREFIX + 3 * rest, _SUFFIX + 3 * rest
    return 2 + code_exp_golomb_in_contexts(coder, prefix, 2, suffix, 2, value - 2, 1)


@inlined
def _code_sign(coder: Any, magnitude: int, value: int) -> int:
    if magnitude and code_bypass(coder, integer(value < 0)):
        return -magnitude
    return magnitude


@inlined
def _code_single(coder: Any, values: Coefficients, i: int) -> None:
    value = integer(values[i, 0])
    magnitude = 1 + _code_magnitude(coder, abs(value) - 1, 0, 0, 0)
    values[i, 0] = _code_sign(coder, magnitude, value)


@inlined
def _code_triple(coder: Any, values: Coefficients, i: int) -> None:
    first, second, third = integer(values[i, 0]), integer(values[i, 1]), integer(values[i, 2])
    b = _code_magnitude(coder, abs(second), 0, 0, 1)
    zero, at_most_one = integer(b == 0), integer(b <= 1)
    c = _code_magnitude(coder, abs(third), 1 + zero, 1 + at_most_one, 1)
    is_first = integer(b == 0 and c == 0)  # then the first component is not zero
    a = is_first + _code_magnitude(
        coder,
        abs(first) - is_first,
        3 + 2 * zero + integer(c == 0),
        3 + 2 * at_most_one + integer(c <= 1),
        0,
    )
    values[i, 0] = _code_sign(coder, a, first)
    values[i, 1] = _code_sign(coder, b, second)
    values[i, 2] = _code_sign(coder, c, third)

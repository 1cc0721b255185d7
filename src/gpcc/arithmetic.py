"""Adaptive binary arithmetic encoder and decoder of G-PCC.

All coding functions take an `Encoder` or a `Decoder`. With an `Encoder`, they encode a value and
return it; with a `Decoder`, they ignore the value and return the decoded one. The coder is the
Schroedinger coder (`schroarith`) of TMC13.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from gpcc.compiled import entry, integer, kernel
from pointkit.compiling import INLINED, inlined

Bytes = NDArray[np.uint8]
Probabilities = NDArray[np.uint16]
State = tuple[int, int, int, int]

HALF = 0x8000
PADDING = 8
"""Maximum number of bytes that a decoder reads beyond the end of a stream."""
_LONGEST_PREFIX = 30

# Decrease of an adaptive probability p of a zero after a one, indexed by p >> 8; after a zero, p
# increases by the entry at 255 - (p >> 8).
ADAPTATION = np.array(
    [
        *(0, 2, 5, 8, 11, 15, 20, 24, 29, 35, 41, 47, 53, 60, 67, 74),
        *(82, 89, 97, 106, 114, 123, 132, 141, 150, 160, 170, 180, 190, 201, 211, 222),
        *(233, 244, 256, 267, 279, 291, 303, 315, 327, 340, 353, 366, 379, 392, 405, 419),
        *(433, 447, 461, 475, 489, 504, 518, 533, 548, 563, 578, 593, 609, 624, 640, 656),
        *(672, 688, 705, 721, 738, 754, 771, 788, 805, 822, 840, 857, 875, 892, 910, 928),
        *(946, 964, 983, 1001, 1020, 1038, 1057, 1076, 1095, 1114, 1133, 1153, 1172, 1192),
        *(1211, 1231, 1251, 1271, 1291, 1311, 1332, 1352, 1373, 1393, 1414, 1435, 1456, 1477),
        *(1498, 1520, 1541, 1562, 1584, 1606, 1628, 1649, 1671, 1694, 1716, 1738, 1760, 1783),
        *(1806, 1828, 1851, 1874, 1897, 1920, 1935, 1942, 1949, 1955, 1961, 1968, 1974, 1980),
        *(1985, 1991, 1996, 2001, 2006, 2011, 2016, 2021, 2025, 2029, 2033, 2037, 2040, 2044),
        *(2047, 2050, 2053, 2056, 2058, 2061, 2063, 2065, 2066, 2068, 2069, 2070, 2071, 2072),
        *(2072, 2072, 2072, 2072, 2072, 2071, 2070, 2069, 2068, 2066, 2065, 2063, 2060, 2058),
        *(2055, 2052, 2049, 2045, 2042, 2038, 2033, 2029, 2024, 2019, 2013, 2008, 2002, 1996),
        *(1989, 1982, 1975, 1968, 1960, 1952, 1943, 1934, 1925, 1916, 1906, 1896, 1885, 1874),
        *(1863, 1851, 1839, 1827, 1814, 1800, 1786, 1772, 1757, 1742, 1727, 1710, 1694, 1676),
        *(1659, 1640, 1622, 1602, 1582, 1561, 1540, 1518, 1495, 1471, 1447, 1422, 1396, 1369),
        *(1341, 1312, 1282, 1251, 1219, 1186, 1151, 1114, 1077, 1037, 995, 952, 906, 857),
        *(805, 750, 690, 625, 553, 471, 376, 255),
    ],
    dtype=np.int64,
)
_RISES = ADAPTATION[::-1].copy()
# Number of doublings that raise a range above 0x4000; no range is below 63.
_DOUBLINGS = np.array([15 - (32 * max(i, 1)).bit_length() for i in range(512)], dtype=np.int64)


class Encoder(NamedTuple):
    """State of an arithmetic encoder with adaptive contexts; the function `encoder` makes one."""

    # Adaptive probability of a zero in each context, in units of 2^-16.
    contexts: Probabilities
    # Lower end and range of the interval; number of bits of the lower end beyond 16; number of
    # bytes written.
    state: NDArray[np.int64]
    data: Bytes


class Decoder(NamedTuple):
    """State of an arithmetic decoder with adaptive contexts; the function `decoder` makes one."""

    # See `Encoder`.
    contexts: Probabilities
    # Code value; range; the code value's bits in excess of 16; bytes read; bytes in the stream; 1
    # if there is a `bypass`; index of the next bit in `bypass`.
    state: NDArray[np.int64]
    data: Bytes
    # Bypass bits of a separate stream, one bit per byte.
    bypass: Bytes


def encoder(contexts: Probabilities, capacity: int) -> Encoder:
    state = np.array([0, 0xFFFF, 0, 0], dtype=np.int64)
    return Encoder(contexts, state, np.empty(capacity, dtype=np.uint8))


def enlarged(coder: Encoder, more: int) -> Encoder:
    used = int(coder.state[3])
    if len(coder.data) - used >= more:
        return coder
    data = np.empty(used + more, dtype=np.uint8)
    data[:used] = coder.data[:used]
    return coder._replace(data=data)


def decoder(contexts: Probabilities, data: Bytes, bypass: Bytes | None = None) -> Decoder:
    padded = np.concatenate([data, np.full(4, 0xFF, dtype=np.uint8)])
    first = int(padded[0]) << 8 | int(padded[1])
    separate = bypass is not None
    bits = bypass if bypass is not None else np.empty(0, dtype=np.uint8)
    state = np.array([first, 0xFFFF, 0, 2, len(data), separate, 0], dtype=np.int64)
    return Decoder(contexts, state, padded, bits)


def consumed(coder: Decoder) -> int:
    """Return the number of bytes that the symbols decoded so far occupy."""
    return int(coder.state[3] - coder.state[2] // 8)


def finish(coder: Encoder) -> bytes:
    _flush(coder)
    return coder.data[: coder.state[3]].tobytes()


def step(coder: Any, state: State, probability: int, bit: int) -> tuple[int, State, int]:
    """Encode or decode one bit, and return the bit, the new state and the new probability."""
    raise NotImplementedError("compiled only")


def bypass_step(coder: Any, state: State, bit: int) -> tuple[int, State]:
    raise NotImplementedError("compiled only")


def exhausted(coder: Any) -> bool:
    """Return whether a decoder has read past the end of the data; False for an encoder."""
    raise NotImplementedError("compiled only")


@overload(exhausted, jit_options=INLINED)
def _exhausted(coder: Any) -> Any:
    return _no if coder.instance_class is Encoder else _overrun


@overload(step, jit_options=INLINED)
def _step(coder: Any, state: Any, probability: Any, bit: Any) -> Any:
    if coder.instance_class is Encoder:
        return _encode
    return _decode


@overload(bypass_step, jit_options=INLINED)
def _bypass_step(coder: Any, state: Any, bit: Any) -> Any:
    if coder.instance_class is Encoder:
        return _encode_bypass
    return _decode_bypass


def _no(coder: Any) -> bool:
    return False


def _overrun(coder: Any) -> bool:
    overrun: bool = coder.state[3] > coder.state[4] + PADDING
    return overrun or coder.state[6] > len(coder.bypass)


def _encode(coder: Any, state: Any, probability: Any, bit: Any) -> tuple[int, State, int]:
    low, span, count, place = state
    split = (span * probability) >> 16
    if bit:
        low += split
        span -= split
        probability -= ADAPTATION[probability >> 8]
    else:
        span = split
        probability += _RISES[probability >> 8]
    if span <= 0x4000:
        doublings = _DOUBLINGS[(span - 1) >> 5]
        low, span, count = low << doublings, span << doublings, count + doublings
        if count >= 8:
            return bit, _emit(coder.data, (low, span, count, place)), probability
    return bit, (low, span, count, place), probability


def _decode(coder: Any, state: Any, probability: Any, bit: Any) -> tuple[int, State, int]:
    code, span, ahead, place = state
    split = (span * probability) >> 16
    if code >= split << ahead:
        bit = 1
        code -= split << ahead
        span -= split
        probability -= ADAPTATION[probability >> 8]
    else:
        bit = 0
        span = split
        probability += _RISES[probability >> 8]
    if span <= 0x4000:
        doublings = _DOUBLINGS[(span - 1) >> 5]
        if ahead < doublings:
            code = code << 32 | _next_word(coder.data, place)
            ahead += 32
            place += 4
        span <<= doublings
        ahead -= doublings
    return bit, (code, span, ahead, place), probability


def _encode_bypass(coder: Any, state: Any, bit: Any) -> tuple[int, State]:
    coded, state, _ = step(coder, state, HALF, bit)
    return coded, state


def _decode_bypass(coder: Any, state: Any, bit: Any) -> tuple[int, State]:
    if coder.state[5]:
        index = coder.state[6]
        coder.state[6] += 1
        return (integer(coder.bypass[index]) if index < len(coder.bypass) else 0), state
    decoded, state, _ = step(coder, state, HALF, bit)
    return decoded, state


@kernel
def _emit(data: Bytes, state: State) -> State:
    # Each byte at once: the end of TMC13's stream depends on a carry out of the last, partial byte.
    low, span, count, place = state
    while count >= 8:
        count -= 8
        byte = low >> (16 + count)
        if byte >> 8:
            _carry(data, place)
        data[place] = byte & 0xFF
        place += 1
        low &= (1 << (16 + count)) - 1
    return low, span, count, place


@kernel
def _carry(data: Bytes, place: int) -> None:
    place -= 1
    while place >= 0 and data[place] == 0xFF:
        data[place] = 0
        place -= 1
    if place >= 0:
        data[place] += 1


@kernel
def _next_word(data: Bytes, place: int) -> int:
    word = 0
    for k in range(4):
        byte = integer(data[place + k]) if place + k < len(data) else 0xFF
        word = word << 8 | byte
    return word


@entry
def _flush(coder: Encoder) -> None:
    low, span, count, place = load(coder)
    ending = 3 if count > 0 else 2
    free = 0
    while free < 16 and low | ((1 << (free + 1)) - 1) <= span - 1:
        free += 1
    low |= (1 << free) - 1
    low = (low + 1 << 8 - count) - 1
    if low >> 24:
        _carry(coder.data, place)
    for k in range(ending):
        coder.data[place + k] = (low >> (16 - 8 * k)) & 0xFF
    save(coder, (low, span, 0, place + ending))


@inlined
def load(coder: Any) -> State:
    state = coder.state
    return state[0], state[1], state[2], state[3]


@inlined
def save(coder: Any, state: State) -> None:
    coder.state[0], coder.state[1], coder.state[2], coder.state[3] = state


@kernel
def code_bit(coder: Any, context: int, bit: int) -> int:
    contexts = coder.contexts
    coded, state, probability = step(coder, load(coder), integer(contexts[context]), bit)
    contexts[context] = probability
    save(coder, state)
    return coded


@kernel
def code_bypass(coder: Any, bit: int) -> int:
    coded, state = bypass_step(coder, load(coder), bit)
    save(coder, state)
    return coded


@kernel
def code_exp_golomb(coder: Any, prefix: int, value: int, order: int = 0) -> int:
    """Encode or decode a number in Exp-Golomb code; its prefix bits share the context `prefix`."""
    base = 0
    while order < 24 and code_bit(coder, prefix, integer(value - base >= 1 << order)):
        base += 1 << order
        order += 1
    rest = 0
    for k in range(order - 1, -1, -1):
        rest |= code_bypass(coder, ((value - base) >> k) & 1) << k
    return base + rest


@kernel
def code_count(coder: Any, nonzero: int, prefix: int, count: int) -> int:
    """Encode or decode a count: a bit that says whether it is 0, then the count minus 1.

    The latter is in Exp-Golomb code; `nonzero` and `prefix` are indices of contexts.
    """
    if not code_bit(coder, nonzero, integer(count > 0)):
        return 0
    return 1 + code_exp_golomb(coder, prefix, count - 1)


@kernel
def code_exp_golomb_in_contexts(
    coder: Any, prefix: int, last_prefix: int, suffix: int, last_suffix: int, value: int, order: int
) -> int:
    """Encode or decode a number in Exp-Golomb code whose bits have separate contexts.

    The first context of the prefix is `prefix`; the last one, `prefix` + `last_prefix`, is that of
    all further bits. The same holds for the suffix. The prefix has at most 30 bits.
    """
    first, base = order, integer(0)
    while order < _LONGEST_PREFIX and code_bit(
        coder, prefix + min(last_prefix, order - first), integer(value - base >= 1 << order)
    ):
        base += 1 << order
        order += 1
    for k in range(order - 1, -1, -1):
        base += code_bit(coder, suffix + min(last_suffix, k), ((value - base) >> k) & 1) << k
    return base


def restart(coder: Decoder) -> None:
    place = min(consumed(coder), int(coder.state[4]))
    first = int(coder.data[place]) << 8 | int(coder.data[place + 1])
    coder.state[:4] = first, 0xFFFF, 0, place + 2

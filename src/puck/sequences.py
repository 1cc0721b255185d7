"""Coding of azimuths and times, which are numbers that rise at a nearly constant rate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.coding.binary_coder import ONE, BitCoder, code, exhausted
from pointkit.coding.context_mixing import Ints, Mixer, MixerOptions, code_bit, new_mixer
from pointkit.compiling import compiled_in_place, inlined

_CONTEXTS = 5
_NODES = 64
_FARTHEST = 24
"""Numbers farther than this from their predictions are coded without predictions."""
_FINE = 8
"""Fractional bits of predictions."""
_RAW_BITS = 32


class SequenceModel(NamedTuple):
    mixer: Mixer
    recent: Ints  # (10,), the last differences from predictions, latest first
    # (4,): predicted next number and mean increment, in 2**-8; 0 before the first number, 1 after a
    # number near its prediction, otherwise 2; last number.
    motion: Ints
    modulus: int  # numbers wrap around at this value


def new_sequence_model(bits: BitCoder, modulus: int) -> SequenceModel:
    """Return a model that has learnt nothing yet, for numbers that wrap around at `modulus`."""
    counters = _NODES * (16 + 81 + 9 * 16 + 81 + 243)
    weights = [0.3] * _CONTEXTS
    options = MixerOptions(contexts=_CONTEXTS, counters=counters, rows=_NODES, weights=weights)
    mixer = new_mixer(bits, options)
    return SequenceModel(mixer, np.zeros(10, np.int64), np.zeros(4, np.int64), modulus)


@compiled_in_place
def code_sequence(model: SequenceModel, numbers: Ints) -> bool:
    """Encode or decode 32-bit numbers in place, and return False if the stream ends early."""
    for i in range(len(numbers)):
        numbers[i] = _code_next(model, numbers[i])
        if exhausted(model.mixer.bits):
            return False
    return True


@inlined
def _code_next(model: SequenceModel, number: int) -> int:
    motion, modulus = model.motion, model.modulus
    half = modulus >> 1
    expected = ((motion[0] + (1 << _FINE - 1)) >> _FINE) % modulus
    difference = (number - expected + half) % modulus - half
    if number >= modulus or motion[2] == 0:
        difference = _FARTHEST + 1
    difference = _code_difference(model, difference)
    if abs(difference) <= _FARTHEST:
        number = (expected + difference) % modulus
        whole = modulus << _FINE
        error = ((number << _FINE) - motion[0] + (whole >> 1)) % whole - (whole >> 1)
        motion[1] += error >> 6
        motion[0] += motion[1] + (error >> 2)
        motion[2] = 1
    else:
        number = _code_plain(model, number)
        if motion[2] == 2 or motion[1] == 0:
            motion[1] = ((number - motion[3] + half) % modulus - half) << _FINE
        motion[0] = (number << _FINE) + motion[1]
        motion[2] = min(motion[2] + 1, 2)
        difference = 0
    motion[0] %= modulus << _FINE
    motion[3] = number
    for k in range(9, 0, -1):
        model.recent[k] = model.recent[k - 1]
    model.recent[0] = difference
    return number


@inlined
def _code_plain(model: SequenceModel, number: int) -> int:
    value = 0
    for k in range(_RAW_BITS - 1, -1, -1):
        value = value << 1 | code(model.mixer.bits, (number >> k) & 1, ONE // 2)
    return value


@inlined
def _code_difference(model: SequenceModel, difference: int) -> int:
    """Code a difference from the prediction; its size is limited to `_FARTHEST` + 1."""
    _write_contexts(model)
    if _decide(model, 0, 1 if difference == 0 else 0) == 1:
        return 0
    sign = _decide(model, 1, 1 if difference > 0 else 0)
    size = 1
    while size <= _FARTHEST and _decide(
        model, 2 + sign * 30 + min(size, 29), 1 if abs(difference) > size else 0
    ):
        size += 1
    return size if sign == 1 else -size


@inlined
def _decide(model: SequenceModel, node: int, bit: int) -> int:
    return code_bit(model.mixer, bit, node, node)


@inlined
def _write_contexts(model: SequenceModel) -> None:
    recent, at = model.recent, model.mixer.contexts
    fraction = ((model.motion[0] + (1 << _FINE - 1)) & ((1 << _FINE) - 1)) >> _FINE - 4
    last, last2 = min(max(recent[0], -4), 4) + 4, min(max(recent[1], -4), 4) + 4
    at[0] = fraction * _NODES
    at[1] = (16 + last * 9 + last2) * _NODES
    at[2] = (16 + 81 + last * 16 + fraction) * _NODES
    last5, last10 = min(max(recent[4], -4), 4) + 4, min(max(recent[9], -4), 4) + 4
    at[3] = (16 + 81 + 144 + last5 * 9 + last10) * _NODES
    signs = 0
    for k in range(5):
        signs = 3 * signs + min(max(recent[k], -1), 1) + 1
    at[4] = (16 + 81 + 144 + 81 + signs) * _NODES

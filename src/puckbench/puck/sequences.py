"""Numbers that grow almost evenly: azimuths of blocks and times of packets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.coding.binary_coder import ONE, BitCoder, code, exhausted
from puckbench.core.compiling import compiled_in_place, inlined
from puckbench.puck.mixing import Ints, Mixer, code_bit, new_mixer

_CONTEXTS = 5
_NODES = 64
_FARTHEST = 24
"""Largest difference from the prediction that is coded as such."""
_FINE = 8
"""Bits of the track's fraction."""
_RAW_BITS = 32


class Track(NamedTuple):
    """State of a sequence.

    recent: (10,) the last differences from predictions, latest first. motion: predicted next number
    and usual step, in 2**-8; 0 before the first number, 1 after one near its prediction, else 2;
    the last number. modulus: of the numbers.
    """

    mixer: Mixer
    recent: Ints
    motion: Ints
    modulus: int


def new_track(bits: BitCoder, modulus: int) -> Track:
    """A sequence that has not begun."""
    counters = _NODES * (16 + 81 + 9 * 16 + 81 + 243)
    mixer = new_mixer(bits, 0, _CONTEXTS, counters, _NODES, 1, (14, 3, 160), [0.3] * _CONTEXTS)
    return Track(mixer, np.zeros(10, np.int64), np.zeros(4, np.int64), modulus)


def track_with_bits(track: Track, bits: BitCoder) -> Track:
    """The sequence going on in another stream."""
    return track._replace(mixer=track.mixer._replace(bits=bits))


@compiled_in_place
def code_sequence(track: Track, numbers: Ints) -> bool:
    """Code numbers of at most 32 bits in place; whether a reader's stream was long enough."""
    for i in range(len(numbers)):
        numbers[i] = _code_next(track, numbers[i])
        if exhausted(track.mixer.bits):
            return False
    return True


@inlined
def _code_next(track: Track, number: int) -> int:
    motion, modulus = track.motion, track.modulus
    half = modulus >> 1
    expected = ((motion[0] + (1 << _FINE - 1)) >> _FINE) % modulus
    rest = (number - expected + half) % modulus - half
    if number >= modulus or motion[2] == 0:
        rest = _FARTHEST + 1
    found = _code_rest(track, rest)
    if abs(found) <= _FARTHEST:
        number = (expected + found) % modulus
        whole = modulus << _FINE
        error = ((number << _FINE) - motion[0] + (whole >> 1)) % whole - (whole >> 1)
        motion[1] += error >> 6
        motion[0] += motion[1] + (error >> 2)
        motion[2] = 1
    else:
        number = _code_plain(track, number)
        if motion[2] == 2 or motion[1] == 0:
            motion[1] = ((number - motion[3] + half) % modulus - half) << _FINE
        motion[0] = (number << _FINE) + motion[1]
        motion[2] = min(motion[2] + 1, 2)
        found = 0
    motion[0] %= modulus << _FINE
    motion[3] = number
    for k in range(9, 0, -1):
        track.recent[k] = track.recent[k - 1]
    track.recent[0] = found
    return number


@inlined
def _code_plain(track: Track, number: int) -> int:
    """Code a number that was not expected."""
    found = 0
    for k in range(_RAW_BITS - 1, -1, -1):
        found = found << 1 | code(track.mixer.bits, (number >> k) & 1, ONE // 2)
    return found


@inlined
def _code_rest(track: Track, rest: int) -> int:
    """Code a difference from the prediction; beyond the farthest, that it is farther."""
    _find_contexts(track)
    if _ask(track, 0, 1 if rest == 0 else 0) == 1:
        return 0
    sign = _ask(track, 1, 1 if rest > 0 else 0)
    size = 1
    while size <= _FARTHEST and _ask(
        track, 2 + sign * 30 + min(size, 29), 1 if abs(rest) > size else 0
    ):
        size += 1
    return size if sign == 1 else -size


@inlined
def _ask(track: Track, node: int, bit: int) -> int:
    return code_bit(track.mixer, bit, node, node)


@inlined
def _find_contexts(track: Track) -> None:
    recent, at = track.recent, track.mixer.at
    part = ((track.motion[0] + (1 << _FINE - 1)) & ((1 << _FINE) - 1)) >> _FINE - 4
    one, two = min(max(recent[0], -4), 4) + 4, min(max(recent[1], -4), 4) + 4
    at[0] = part * _NODES
    at[1] = (16 + one * 9 + two) * _NODES
    at[2] = (16 + 81 + one * 16 + part) * _NODES
    five, ten = min(max(recent[4], -4), 4) + 4, min(max(recent[9], -4), 4) + 4
    at[3] = (16 + 81 + 144 + five * 9 + ten) * _NODES
    signs = 0
    for k in range(5):
        signs = 3 * signs + min(max(recent[k], -1), 1) + 1
    at[4] = (16 + 81 + 144 + 81 + signs) * _NODES

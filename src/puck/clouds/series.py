"""Coding of a column of integers by differences from the best of several predictions.

Each prediction copies or continues a pattern: the value before, the last value of the same ring,
the value above in an organised cloud, or the same place in the cloud before. For each value, the
prediction with the least recent errors is chosen.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.binary_coder import BitCoder, code_uniform, exhausted
from pointkit.coding.context_mixing import Ints, Mixer, MixerOptions, Words, code_bit, new_mixer
from pointkit.coding.intrinsics import leading_zeros
from pointkit.compiling import compiled_in_place, inlined
from puck.numbers import code_unmixed_bit

RINGS = 256
"""Number of rings that are told apart; larger numbers of rings are taken modulo this."""
_NODES = 112
_LEVELS, _FEW = 12, 4
_FEW_BITS = 12
"""Number of low bits of a difference that are coded at once, all values being equally likely."""
PREDICTIONS = 10
"""Number of predictions of a value."""
FOLLOWERS = 1 << 16
"""Number of entries of the table of the last place of a value, by its hash."""
_CONTEXTS = 5
_EXTRA = 256
_SIZES = np.array([16 * PREDICTIONS, RINGS * 3, _LEVELS**2, 1 << PREDICTIONS, _EXTRA]) * _NODES
_ALL = int(_SIZES.sum())
STARTS = np.cumsum(_SIZES) - _SIZES


class SeriesModel(NamedTuple):
    mixer: Mixer
    scores: Ints  # recent costs of the predictions
    starts: Ints


def new_series_model(bits: BitCoder, is_fast: bool) -> SeriesModel:
    """Return a model that has learnt nothing yet; `is_fast` selects one context without mixing."""
    contexts = 1 if is_fast else _CONTEXTS
    options = MixerOptions(contexts=contexts, counters=_ALL, rows=_NODES, weights=[0.3] * contexts)
    return SeriesModel(new_mixer(bits, options), np.zeros(PREDICTIONS, np.int64), STARTS)


@inlined
def level(difference: int) -> int:
    """Return the level of a signed difference, from 0 for zero to `_LEVELS` - 1."""
    size = abs(difference)
    if size == 0:
        return 0
    if size < _FEW:
        return (1 if size == 1 else 3) + (1 if difference > 0 else 0)
    octave: int = 64 - leading_zeros(size)
    return min(3 + (octave >> 1), _LEVELS - 1)


@inlined
def _decide(mixer: Mixer, node: int, bit: int) -> int:
    if len(mixer.sizes.contexts) == 1:
        return code_unmixed_bit(mixer, mixer.contexts[0] + node, bit)
    return code_bit(mixer, bit, node, node)


@inlined
def code_signed(mixer: Mixer, difference: int) -> int:
    """Encode or decode a signed difference of up to 64 bits in the mixer's contexts."""
    if _decide(mixer, 0, 1 if difference == 0 else 0) == 1:
        return 0
    is_up = _decide(mixer, 1, 1 if difference > 0 else 0)
    size = abs(difference) - 1
    octave = 63 - leading_zeros(size + 1) if size >= 0 and size + 1 > 0 else 63
    length = 0
    while length < 63 and _decide(mixer, 2 + min(length, 39), 1 if octave > length else 0) == 1:
        length += 1
    rest, number = size + 1, 1
    if length > 0:
        length -= 1
        number = 2 | _decide(mixer, 42 + min(length, 29), (rest >> length) & 1)
    if length > 0:
        length -= 1
        node = 72 + min(length, 19) * 2 + (number & 1)
        number = number << 1 | _decide(mixer, node, (rest >> length) & 1)
    while length > 0:
        few = min(length, _FEW_BITS)
        length -= few
        part = (rest >> length) & ((1 << few) - 1)
        number = number << few | code_uniform(mixer.bits, part, 1 << few)
    return number if is_up == 1 else -number


@inlined
def _wrapped(difference: int, width: int) -> int:
    """Return a difference modulo 2 ** width, as a signed number of `width` bits."""
    return difference << (64 - width) >> (64 - width)


@compiled_in_place
def code_series(
    model: SeriesModel, values: Ints, rings: Words, before: Ints,
    skips: NDArray[np.bool_], width: int, bits: int, guesses: Ints, differences: Ints, last: Words,
    places: Words,
) -> bool:  # fmt: skip
    """Encode or decode a column in place, and return False if the stream ends early.

    Parameters
    ----------
    model
        The model, which holds the arithmetic encoder or decoder.
    values
        The column (n,).
    rings
        Number of each point's ring (n,), less than `RINGS`.
    before
        The same column in the cloud before, (m,).
    skips
        Whether each value is not coded, but set to its prediction (n,).
    width
        Number of points in a row of an organised cloud, otherwise 0.
    bits
        Number of bits of the values.
    guesses, differences, last, places
        Working memory (`PREDICTIONS`,), (n,), (2, `RINGS`) and (`FOLLOWERS`,), which is -1.
    """
    mixer, history, is_fast = model.mixer, 0, len(model.mixer.sizes.contexts) == 1
    last[:] = -1
    for i in range(len(values)):
        ring = rings[i]
        j = int(last[0, ring])
        k = int(last[1, rings[i - 1]]) if i > 0 else -1
        _write_guesses(values, before, i, j, k, width, guesses)
        guesses[9] = _follower(values, places, i, guesses[6])
        best = _best(model.scores)
        guess = guesses[best]
        last[1, ring], last[0, ring] = last[0, ring], i
        if skips[i]:
            values[i], differences[i] = guess, 0
            continue
        own = level(differences[j]) if j >= 0 else _LEVELS - 1
        recent = level(differences[i - 1]) if i > 0 else 0
        if is_fast:
            mixer.contexts[0] = model.starts[2] + (recent * _LEVELS + own) * _NODES
        else:
            _write_contexts(model, guesses, best, history, ring, recent, own)
        difference = code_signed(mixer, _wrapped(values[i] - guess, bits))
        value = guess + difference
        if bits < 64:
            value &= (1 << bits) - 1
        values[i], differences[i] = value, difference
        history = (history << 1 & 15) | (1 if difference == 0 else 0)
        if not is_fast or difference != 0 or i & 15 == 0:
            _score(model.scores, guesses, value, bits)
        if i & 255 == 0 and exhausted(mixer.bits):
            return False
    return not exhausted(mixer.bits)


@inlined
def _write_guesses(
    values: Ints, before: Ints, i: int, j: int, k: int, width: int, guesses: Ints
) -> None:
    """Write predictions of value i; j and k are the last places on the rings of i and i - 1."""
    last = values[i - 1] if i > 0 else 0
    own = values[j] if j >= 0 else last
    guesses[0], guesses[1] = last, 2 * last - values[i - 2] if i > 1 else last
    guesses[2] = last + (values[k + 1] - values[k]) if k >= 0 else last
    guesses[3], guesses[4] = own, own + (last - values[k]) if k >= 0 else own
    up = values[i - width] if 0 < width <= i else own
    guesses[5], guesses[6] = up, up + (last - values[i - width - 1]) if 0 < width < i else up
    then = before[i] if i < len(before) else last
    guesses[7], guesses[8] = then, then + (last - before[i - 1]) if 0 < i < len(before) else then


@inlined
def _follower(values: Ints, places: Words, i: int, other: int) -> int:
    """Return the value that came after the last one when that was seen before, or `other`."""
    last = values[i - 1] if i > 0 else 0
    slot = np.uint64(((last * 0x9E3779B1) >> 20) & (FOLLOWERS - 1))
    place = int(places[slot])
    places[slot] = i - 1
    return values[place + 1] if place >= 0 and values[place] == last else other


@inlined
def _best(scores: Ints) -> int:
    best = 0
    for k in range(1, PREDICTIONS):
        if scores[k] < scores[best]:
            best = k
    return best


@inlined
def _score(scores: Ints, guesses: Ints, value: int, bits: int) -> None:
    for k in range(PREDICTIONS):
        cost = (64 - leading_zeros(abs(_wrapped(value - guesses[k], bits)))) << 12
        scores[k] += (cost - scores[k]) >> 5


@inlined
def _write_contexts(
    model: SeriesModel, guesses: Ints, best: int, history: int, ring: int, recent: int, own: int
) -> None:
    at, starts, agreed = model.mixer.contexts, model.starts, 0
    for k in range(PREDICTIONS):
        agreed = agreed << 1 | (1 if guesses[k] == guesses[best] else 0)
    at[0] = starts[0] + (history * PREDICTIONS + best) * _NODES
    at[1] = starts[1] + (ring * 3 + min(own, 2)) * _NODES
    at[2] = starts[2] + (recent * _LEVELS + own) * _NODES
    at[3] = starts[3] + agreed * _NODES
    at[4] = starts[4] + ring * _NODES


@compiled_in_place
def code_residuals(
    model: SeriesModel, values: Ints, rings: Words, extra: NDArray[np.uint8], last: Ints
) -> bool:
    """Encode or decode errors (n,) of predictions in place; see `code_series`.

    The argument `last` is working memory (RINGS,).
    """
    mixer, starts, history, before = model.mixer, model.starts, 0, 0
    last[:] = 0
    for i in range(len(values)):
        ring, at = rings[i], mixer.contexts
        own, recent = level(last[ring]), level(before)
        if len(mixer.sizes.contexts) == 1:
            at[0] = starts[4] + int(extra[i]) * _NODES
        else:
            at[0] = starts[0] + history * _NODES
            at[1] = starts[1] + (ring * 3 + min(own, 2)) * _NODES
            at[2] = starts[2] + (recent * _LEVELS + own) * _NODES
            at[3] = starts[3] + (int(extra[i]) * 2 + min(own, 1)) * _NODES
            at[4] = starts[4] + int(extra[i]) * _NODES
        before = code_signed(mixer, values[i])
        values[i] = before
        last[ring] = before
        history = (history << 1 & 15) | (1 if before == 0 else 0)
        if i & 255 == 0 and exhausted(mixer.bits):
            return False
    return not exhausted(mixer.bits)

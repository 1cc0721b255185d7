"""Coding of an Ouster's images at effort `fast`: ranges, signals, reflectivities and others.

Adaptive least squares predict a pixel from its neighbours and the previous turn (revolution). The
prediction error is split into low bits, which are stored uncoded, and a symbol. The context of a
symbol is the size of nearby errors.

Symbols are coded by asymmetric numeral systems (rANS; Duda 2013) with adaptive frequencies. A
symbol, one of about a hundred, takes one step, which is several times faster than as many binary
decisions with `pointkit.coding`, by which all other efforts and sensors are coded. Two states
alternate. An encoder first collects tokens, and then codes them from the last to the first.
"""

from __future__ import annotations

from collections.abc import Container
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader
from pointkit.coding.context_mixing import Ints, Words
from pointkit.coding.intrinsics import leading_zeros
from pointkit.compiling import compiled_in_place, inlined
from pointkit.threads import in_threads
from puck.experts import FINE
from puck.gains import Gains, estimated, estimated_only, learn_estimate, new_gains
from puck.gaps import compress_bytes, decompress_bytes
from puck.numbers import halves
from puck.ranges import PAD
from puck.records import check

_SCALE = 12
_SLOTS = 1 << _SCALE
"""Sum of the frequencies of symbols."""
_LOW = 1 << 31
"""Least state of a coder between symbols."""
_STATE_WORDS, _WORD_BYTES = 4, 4
_DENSE, _OCTAVES = 48, 26
"""Numbers of symbols for small errors, and for octaves of larger errors of each sign."""
_ZERO = _DENSE + 2 * _OCTAVES
_SYMBOLS = _ZERO + 1
_LEVELS = 20
_CONTEXTS = 8 * _LEVELS
"""Number of contexts, by which of three neighbours are 0, and by errors around the pixel."""
_COUNT = 24
"""Increase of a symbol's count when it is coded."""
_MOST_COUNTS = 1 << 17
_FEATURES = 8
_CLIP = 60 * FINE
"""Limit of features. Larger differences are edges in images of ranges and become 0; in other images
they are clipped."""
_FEW_BITS = 16
"""A coder's state has room for a symbol and this number of low bits."""
_LARGEST = 1 << 17
"""Limit of coefficients, in units of 2**-16."""
_RIDGE = 5000
_LEARNT = 64
"""Number of columns after which least squares learn from every fourth column only, and tables of
gains from every eighth laser."""
_MOST_ERROR = 1 << 16
_FIRST_ERROR = 48
_FEW = 32
"""Pixels above 0 are listed if they are at most 1 / 32 of an image."""
_CODED, _LISTED = b"\0", b"\1"
"""First byte of a part."""


class _RansCoder(NamedTuple):
    registers: NDArray[
        np.uint64
    ]  # index of the next word or token, states of two alternating coders
    words: NDArray[np.uint32]  # of the stream, and a final 0; only in a reader
    tokens: NDArray[np.uint64]  # to be coded, one for each pixel; empty in a reader


class _Model(NamedTuple):
    counts: Words  # (contexts, symbols)
    totals: Ints  # (contexts,), sums of the counts when tables were made
    pairs: NDArray[np.uint32]  # (contexts, symbols), 2 ** 16 times a frequency plus its start
    slots: NDArray[np.uint8]  # (contexts, _SLOTS), symbols
    products: Ints  # (features, features), weighted sums of products of features
    moments: Ints  # (features,), weighted sums of products of features and responses
    coefficients: Ints
    x: Words  # (features, lasers), of a column
    weighted: Words
    columns: (
        Words  # (6, lasers), of a column: sums, errors, contexts, estimates, responses, weights
    )
    error: Words  # (lasers,), running means of errors
    coded: Ints  # number of columns
    gains: Gains
    has_signals: bool  # whether pixels are reflectivities, which depend on range and signal
    has_reference: bool
    is_range: bool
    farthest: int


class _Image(NamedTuple):
    """Arrays (PAD + columns + PAD, 1 + lasers + 1), whose borders repeat the outer lasers."""

    values: Words
    held: Words  # last nonzero value of the laser, less its estimate, in 1 / FINE
    errors: Words  # absolute prediction errors, in 1 / FINE


class ImageJob(NamedTuple):
    """An image to encode or decode.

    Parameters
    ----------
    number
        Index of the image within a turn.
    values
        Pixels (columns, lasers). A decoder uses only the shape.
    farthest
        Largest possible value of a pixel.
    ranges
        Ranges of the same returns with borders, as `framed` returns them; None if the pixels are
        ranges.
    signals
        Signals of the same returns with borders, if the pixels are reflectivities.
    reference
        Image with borders, from which pixels are predicted. For ranges of second returns, these are
        the ranges of first returns.
    """

    number: int
    values: NDArray[Any]
    farthest: int
    ranges: Words | None = None
    signals: Words | None = None
    reference: Words | None = None


def _new_model(job: ImageJob) -> _Model:
    lasers = job.values.shape[1]
    x = np.zeros((_FEATURES, lasers), np.int32)
    counts, totals, pairs, slots = _first_tables()
    return _Model(
        counts.copy(), totals.copy(), pairs.copy(), slots.copy(),
        np.zeros((_FEATURES, _FEATURES), np.int64), np.zeros(_FEATURES, np.int64),
        np.zeros(_FEATURES, np.int64), x, x.copy(), x[:6].copy(),
        np.full(lasers, _FIRST_ERROR, np.int32), np.zeros(1, np.int64),
        new_gains(lasers, job.farthest), job.signals is not None,
        job.reference is not None, job.ranges is None, job.farthest,
    )  # fmt: skip


@cache
def _first_tables() -> tuple[Words, Ints, NDArray[np.uint32], NDArray[np.uint8]]:
    """Return the initial counts, totals, pairs and slots of a `_Model`."""
    counts = np.zeros((_CONTEXTS, _SYMBOLS))
    for context in range(_CONTEXTS):
        empty, level = divmod(context, _LEVELS)
        size = 2.0 ** (level / 2 - 1)
        k = max(level // 2 - 3, 0)
        edges = np.arange(-_DENSE // 2, _DENSE // 2 + 1) * float(1 << k)
        decay = np.exp(-np.abs(edges) / size)
        cumulative = np.where(edges < 0, decay / 2, 1 - decay / 2)
        octaves = 0.02 * 0.75 ** np.arange(_OCTAVES)
        share = (0.01, 0.1, 0.6, 0.95)[empty.bit_count()]
        counts[context, :_DENSE] = np.diff(cumulative) * (1 - share)
        counts[context, _DENSE:_ZERO] = np.tile(octaves, 2) * (1 - share)
        counts[context, _ZERO] = share
    tables = (
        np.rint(64 * _COUNT * counts).astype(np.int32),
        np.full(_CONTEXTS, -_MOST_COUNTS),
        np.zeros((_CONTEXTS, _SYMBOLS), np.uint32),
        np.zeros((_CONTEXTS, _SLOTS), np.uint8),
    )
    _make_tables(*tables)
    return tables


@compiled_in_place
def _make_tables(
    counts: Words, totals: Ints, pairs: NDArray[np.uint32], slots: NDArray[np.uint8]
) -> None:
    for context in range(_CONTEXTS):
        total = 0
        for symbol in range(_SYMBOLS):
            total += counts[context, symbol]
        if total - totals[context] > 32 * _COUNT:
            _make_table(counts[context], pairs[context], slots[context], total)
            totals[context] = total >> 1 if total > _MOST_COUNTS else total


@inlined
def _make_table(
    counts: Words, pairs: NDArray[np.uint32], slots: NDArray[np.uint8], total: int
) -> None:
    free = _SLOTS - _SYMBOLS
    share, left, most = (free << 32) // total, free, 0
    for symbol in range(_SYMBOLS):
        left -= counts[symbol] * share >> 32
        most = symbol if counts[symbol] > counts[most] else most
    start = 0
    for symbol in range(_SYMBOLS):
        size = 1 + (counts[symbol] * share >> 32) + (left if symbol == most else 0)
        pairs[symbol] = size << 16 | start
        for slot in range(start, start + size):
            slots[np.uint64(slot)] = symbol
        start += size
    if total > _MOST_COUNTS:
        for symbol in range(_SYMBOLS):
            counts[symbol] -= counts[symbol] >> 1


@compiled_in_place
def _code_image(
    model: _Model, coder: _RansCoder, image: _Image, before: _Image, ranges: Words, signals: Words,
    reference: Words, nearest: Ints,
) -> bool:  # fmt: skip
    """Encode or decode an image, and return False if the stream that is decoded ended early.

    An encoder reads `image.values`, and a decoder writes them; both write the other arrays of
    `image`. The arguments `before` and `nearest` are those of `ranges.code_ranges`.
    """
    for c in range(PAD, PAD + len(nearest)):
        t = nearest[c - PAD]
        previous = before.held[t] if t > 0 else image.held[c - 1]
        _begin_column(model, image, before, ranges, previous, c, t)
        _estimate_column(model, ranges[c], signals[c], reference[c])
        _code_column(model, coder, image, previous, c)
        _learn_column(model, image, ranges[c], signals[c], previous, c)
        if len(coder.tokens) == 0 and coder.registers[0] >= len(coder.words):
            return False
    return True


@inlined
def _bounded(change: int, is_range: bool) -> int:
    if is_range:
        return change if abs(change) <= _CLIP else 0
    return min(max(change, -_CLIP), _CLIP)


@inlined
def _write_feature(model: _Model, k: int, later: Words, earlier: Words, i: int, j: int) -> None:
    x = model.x[k]
    for laser in range(len(x)):
        x[laser] = _bounded(later[laser + i] - earlier[laser + j], model.is_range)


@inlined
def _begin_column(
    model: _Model, image: _Image, before: _Image, ranges: Words, previous: Words, c: int, t: int
) -> None:
    """Compute the features and contexts of a column that do not depend on the column's pixels."""
    held, errors = image.held, image.errors
    west, west2 = held[c - 1], held[c - 2]
    _write_feature(model, 0, west2, west, 1, 1)
    _write_feature(model, 1, held[c - 3], west, 1, 1)
    _write_feature(model, 5, previous, west, 1, 1)
    _write_feature(model, 7, west2, west, 0, 0)
    if not model.is_range:
        _write_feature(model, 3, west, west, 0, 1)
        _write_feature(model, 4, west, west, 2, 1)
    else:
        _write_feature(model, 3, before.held[t + 1] if t > 0 else west, west, 1, 1)
        _write_feature(model, 4, before.held[t - 1] if t > 0 else west, west, 1, 1)
    x, w, error = model.x, model.coefficients, model.error
    sums, around, empty = model.columns[0], model.columns[1], model.columns[2]
    third = ranges[c] if not model.is_range else before.values[t] if t > 0 else image.values[c - 2]
    above, values = errors[c - 1], image.values[c - 1]
    for k in range(len(sums)):
        sums[k] = (
            x[0, k] * w[0] + x[1, k] * w[1] + x[3, k] * w[3] + x[4, k] * w[4] + x[5, k] * w[5]
            + x[7, k] * w[7]
        )  # fmt: skip
        around[k] = 2 * error[k] + above[k + 2]
        empty[k] = (2 if values[k + 1] == 0 else 0) + (1 if third[k + 1] == 0 else 0)
    if t > 0:
        past, east, back = before.errors[t], before.errors[t + 1], before.errors[t - 1]
        for k in range(len(around)):
            around[k] += 2 * past[k + 1] + east[k + 1] + back[k + 1]
    else:
        for k in range(len(around)):
            around[k] += 4 * error[k]


@inlined
def _estimate_column(model: _Model, ranges: Words, signals: Words, reference: Words) -> None:
    estimates = model.columns[3]
    if model.has_signals:
        for laser in range(len(estimates)):
            distance, signal = int(ranges[laser + 1]), int(signals[laser + 1])
            estimates[laser] = estimated_only(model.gains, distance, signal, laser)
    elif model.has_reference:
        for laser in range(len(estimates)):
            estimates[laser] = FINE * reference[laser + 1]


@inlined
def _code_column(model: _Model, coder: _RansCoder, image: _Image, previous: Words, c: int) -> None:
    values, held, errors = image.values[c], image.held[c], image.errors[c]
    sums, around, empty, estimates = (
        model.columns[0], model.columns[1], model.columns[2], model.columns[3],
    )  # fmt: skip
    west, west_errors = image.held[c - 1], image.errors[c - 1]
    w2, w6 = model.coefficients[2], model.coefficients[6]
    place, state, other = coder.registers[0], coder.registers[1], coder.registers[2]
    is_writing = len(coder.tokens) > 0
    below, below_error, below_empty = west[1], west_errors[1], empty[0] >> 1
    held[0], errors[0], values[0] = below, below_error, image.values[c - 1, 1]
    for laser in range(len(sums)):
        base, estimate = west[laser + 1], estimates[laser]
        mean = w2 * _bounded(below - west[laser], model.is_range)
        mean += w6 * _bounded(below - previous[laser], model.is_range)
        mean = base + ((sums[laser] + mean) >> 16) + estimate
        mean = min(max(mean, FINE), FINE * model.farthest)
        centre = (mean + FINE // 2) // FINE
        level = min(max(halves((around[laser] + below_error) >> 3) - 6, 0), _LEVELS - 1)
        context = np.uint64((empty[laser] + 4 * below_empty) * _LEVELS + level)
        kept = max((level >> 1) - 3, 0)
        if is_writing:
            value = int(values[laser + 1])
            coder.tokens[place] = _token(model, context, kept, value, centre)
            place += np.uint64(1)
        else:
            value, state, place = _next_value(
                model, coder.words, state, place, context, kept, centre
            )
            values[laser + 1] = value
            state, other = other, state
        below, below_error, below_empty = base, west_errors[laser + 1], 1
        if value > 0:
            below_error, below_empty = min(abs(FINE * value - mean), _MOST_ERROR), 0
            if estimate > 0 or not model.has_signals:
                below = FINE * value - estimate
        held[laser + 1], errors[laser + 1] = below, below_error
    coder.registers[0], coder.registers[1], coder.registers[2] = place, state, other
    end = len(sums)
    values[end + 1], held[end + 1], errors[end + 1] = values[end], below, below_error


@inlined
def _token(model: _Model, context: np.uint64, k: int, value: int, centre: int) -> np.uint64:
    symbol, raw, more = _ZERO, 0, 0
    if value != 0:
        apart = (value - centre) >> k
        raw, more = (value - centre) & ((1 << k) - 1), k
        symbol = apart + _DENSE // 2
        if symbol < 0 or symbol >= _DENSE:
            size = symbol - _DENSE + 1 if symbol > 0 else -symbol
            octave = 63 - leading_zeros(size)
            raw |= (size - (1 << octave)) << k
            more = k + octave
            symbol = _DENSE + octave + (0 if symbol > 0 else _OCTAVES)
    place = np.uint64(symbol)
    model.counts[context, place] += _COUNT
    pair = np.uint64(model.pairs[context, place])
    return pair | np.uint64(more) << np.uint64(32) | np.uint64(raw) << np.uint64(37)


@inlined
def _next_value(
    model: _Model, words: NDArray[np.uint32], state: np.uint64, place: np.uint64,
    context: np.uint64, kept: int, centre: int,
) -> tuple[int, np.uint64, np.uint64]:  # fmt: skip
    slot = state & np.uint64(_SLOTS - 1)
    index = np.uint64(model.slots[context, slot])
    pair = np.uint64(model.pairs[context, index])
    model.counts[context, index] += _COUNT
    state = (pair >> np.uint64(16)) * (state >> np.uint64(_SCALE))
    state += slot - (pair & np.uint64(0xFFFF))
    symbol: Any = np.int64(index)  # mixed with signed ones, an unsigned number becomes a float
    value = 0
    if symbol < _DENSE:
        apart = (symbol - _DENSE // 2 << kept) + (np.int64(state) & (1 << kept) - 1)
        state >>= np.uint64(kept)
        value = min(max(centre + apart, 1), model.farthest)
    elif symbol != _ZERO:
        is_up = symbol < _DENSE + _OCTAVES
        octave = symbol - _DENSE - (0 if is_up else _OCTAVES)
        more = np.uint64(kept + octave)
        if more > np.uint64(_FEW_BITS):
            state, place = _refilled(words, state, place)
        raw: Any = np.int64(state & (np.uint64(1) << more) - np.uint64(1))
        state >>= more
        size = (raw >> kept) + (1 << octave)
        apart = size - 1 + _DENSE // 2 if is_up else -size - _DENSE // 2
        apart = (apart << kept) + (raw & (1 << kept) - 1)
        value = min(max(centre + apart, 1), model.farthest)
    state, place = _refilled(words, state, place)
    return value, state, place


@inlined
def _refilled(
    words: NDArray[np.uint32], state: np.uint64, place: np.uint64
) -> tuple[np.uint64, np.uint64]:
    word = np.uint64(words[min(place, np.uint64(len(words) - 1))])
    is_low = state < np.uint64(_LOW)
    place += np.uint64(1) if is_low else np.uint64(0)
    return (state << np.uint64(32) | word if is_low else state), place


@inlined
def _learn_column(
    model: _Model, image: _Image, ranges: Words, signals: Words, previous: Words, c: int
) -> None:
    error, errors, coded = model.error, image.errors[c], model.coded[0]
    for laser in range(len(error)):
        error[laser] += (errors[laser + 1] - error[laser]) >> 2
    if coded & 3 == 0 or coded < _LEARNT:
        _write_feature(model, 2, image.held[c], image.held[c - 1], 0, 0)
        _write_feature(model, 6, image.held[c], previous, 0, 0)
        _write_weights(model, image, c)
        _learn_linear(model)
    if model.has_signals:
        first, step = (0, 1) if coded < _LEARNT else (coded & 7, 8)
        for laser in range(first, len(error), step):
            distance, signal = int(ranges[laser + 1]), int(signals[laser + 1])
            value = int(image.values[c, laser + 1])
            if value > 0 and estimated(model.gains, distance, signal, laser) > 0:
                learn_estimate(model.gains, value)
    coded += 1
    model.coded[0] = coded
    if coded & 63 == 0 or (coded < 64 and coded & (coded - 1) == 0):
        _make_tables(model.counts, model.totals, model.pairs, model.slots)


@inlined
def _write_weights(model: _Model, image: _Image, c: int) -> None:
    """Write a column's least squares responses and weights; large errors have small weights."""
    values, held, west, errors = image.values[c], image.held[c], image.held[c - 1], image.errors[c]
    around, responses, weights = model.columns[1], model.columns[4], model.columns[5]
    for k in range(len(weights)):
        weights[k] = 256 if values[k + 1] > 0 and errors[k + 1] <= _CLIP else 0
        responses[k] = held[k + 1] - west[k + 1] if weights[k] > 0 else 0
    for bound in range(8, 15):
        for k in range(len(weights)):
            weights[k] >>= 1 if around[k] > 1 << bound else 0


@inlined
def _learn_linear(model: _Model) -> None:
    x, responses, weights = model.x, model.columns[4], model.columns[5]
    products, moments, coefficients = model.products, model.moments, model.coefficients
    for i in range(_FEATURES):
        weighted, feature = model.weighted[i], x[i]
        for k in range(len(weights)):
            weighted[k] = feature[k] * weights[k] >> 8
        for j in range(i + 1):
            other, total = x[j], 0
            for k in range(len(weights)):
                total += weighted[k] * other[k]
            products[i, j] += total - (products[i, j] >> 5)
            products[j, i] = products[i, j]
        total = 0
        for k in range(len(weights)):
            total += weighted[k] * responses[k]
        moments[i] += total - (moments[i] >> 5)
    for i in range(_FEATURES):
        residual = moments[i] << 16
        for j in range(_FEATURES):
            residual -= products[i, j] * coefficients[j]
        solution = coefficients[i] + residual // (products[i, i] + _RIDGE)
        coefficients[i] = min(max(solution, -_LARGEST), _LARGEST)


@compiled_in_place
def _write_words(coder: _RansCoder, out: NDArray[np.uint32]) -> int:
    """Code the tokens, last first, to the end of `out`, and return the index of the first word."""
    place, next_state, state = len(out), np.uint64(_LOW), np.uint64(_LOW)
    for k in range(coder.registers[0], 0, -1):
        token = coder.tokens[np.uint64(k - 1)]
        start, size = token & np.uint64(0xFFFF), token >> np.uint64(16) & np.uint64(0xFFFF)
        more, raw = token >> np.uint64(32) & np.uint64(31), token >> np.uint64(37)
        if more > np.uint64(_FEW_BITS):
            if state >> np.uint64(63) - more != 0:
                place -= 1
                out[np.uint64(place)] = state & np.uint64(0xFFFFFFFF)
                state >>= np.uint64(32)
            state = state << more | raw
            more, raw = np.uint64(0), np.uint64(0)
        if state >= size << np.uint64(63 - _SCALE) - more:
            place -= 1
            out[np.uint64(place)] = state & np.uint64(0xFFFFFFFF)
            state >>= np.uint64(32)
        state = state << more | raw
        ratio = state // size
        state += ratio * np.uint64(_SLOTS) - ratio * size + start
        state, next_state = next_state, state
    coder.registers[1], coder.registers[2] = next_state, state
    return place


def framed(values: NDArray[Any]) -> Words:
    """Return an image (columns, lasers) as (columns + 2 PAD, lasers + 2), with a border of zeros.

    Jobs of other images take such an image as `ranges`, `signals` or `reference`.
    """
    framed = np.zeros((len(values) + 2 * PAD, values.shape[1] + 2), np.int32)
    framed[PAD:-PAD, 1:-1] = values
    return framed


class ImageCoder:
    """Encoder and decoder of the images of successive turns.

    Images with the same number share an adaptive model, which learns from turn to turn.
    """

    def __init__(self) -> None:
        self._models: dict[int, _Model] = {}
        self._coded: dict[int, _Image] = {}

    def keep(self, numbers: Container[int]) -> None:
        """Forget all images of the previous turn except those with the given numbers."""
        self._coded = {k: image for k, image in self._coded.items() if k in numbers}

    def encode(self, jobs: list[ImageJob], nearest: Ints) -> tuple[list[Words], list[bytes]]:
        """Encode the images of a turn.

        Parameters
        ----------
        jobs
            The images.
        nearest
            For each column, the row of the nearest column in the previous turn, as in
            `ranges.code_ranges`.

        Returns
        -------
        images
            Each image with borders, (columns + 2 PAD, lasers + 2).
        parts
            The bytes of each image in the stream.
        """
        coded = in_threads(lambda job: self._code(job, nearest, None), jobs)
        return [image for image, _ in coded], [part for _, part in coded]

    def decode(self, jobs: list[ImageJob], nearest: Ints, parts: list[bytes]) -> list[Words]:
        """Decode the images of a turn.

        Parameters
        ----------
        jobs
            The images, of which only shapes are read.
        nearest
            As in `encode`.
        parts
            The bytes of each image, as `encode` returned them.

        Returns
        -------
        list of array (columns + 2 PAD, lasers + 2)
            Each image with borders.

        Raises
        ------
        InputError
            A part is damaged.
        """
        pairs = zip(jobs, parts, strict=True)
        coded = in_threads(lambda pair: self._code(pair[0], nearest, pair[1]), pairs)
        return [image for image, _ in coded]

    def _code(self, job: ImageJob, nearest: Ints, part: bytes | None) -> tuple[Words, bytes]:
        columns, lasers = job.values.shape
        image = _Image(*np.zeros((3, columns + 2 * PAD, lasers + 2), np.int32))
        inside, former = image.values[PAD:-PAD, 1:-1], self._coded.pop(job.number, None)
        if part is None:
            part = _listed(job.values)
            if not part:
                inside[:] = job.values
        if part[:1] == _LISTED:
            _write_listed(inside, part[1:], job.farthest)
            return image.values, part
        model = self._models.get(job.number)
        if model is None or model.farthest != job.farthest:
            model = self._models[job.number] = _new_model(job)
        coder = _reader(part[1:]) if part else _writer(columns * lasers)
        image.errors[:PAD] = _FIRST_ERROR
        if former is not None:
            for array, earlier in zip(image, former, strict=True):
                array[:PAD] = earlier[-2 * PAD : -PAD]
        rows = np.zeros_like(nearest) if former is None else nearest
        none = image.values  # arrays that are not used
        is_complete = _code_image(
            model, coder, image, former or image, none if job.ranges is None else job.ranges,
            none if job.signals is None else job.signals,
            none if job.reference is None else job.reference, rows,
        )  # fmt: skip
        self._coded[job.number] = image
        if not part:
            return image.values, _CODED + _written(coder)
        check(is_complete and coder.registers.tolist() == [len(coder.words) - 1, _LOW, _LOW])
        return image.values, part


def _listed(image: NDArray[Any]) -> bytes:
    """Return the nonzero pixels and their indices, compressed, or no bytes if there are many."""
    if _FEW * np.count_nonzero(image) > image.size:
        return b""
    places = np.flatnonzero(image)
    steps, values = np.diff(places, prepend=0), image.ravel()[places]
    listed = np.stack([steps, values]).astype("<u4").view(np.uint8)
    return _LISTED + compress_bytes(listed.reshape(-1, 4).T.tobytes(), are_headers=True)


def _write_listed(image: Words, body: bytes, farthest: int) -> None:
    def admit(size: int) -> None:
        check(size % 8 == 0 and _FEW * size <= 8 * image.size)

    raw = np.frombuffer(decompress_bytes(Reader(body), admit), np.uint8)
    listed = np.ascontiguousarray(raw.reshape(4, -1).T).view("<u4").reshape(2, -1)
    places = np.cumsum(listed[0], dtype=np.int64)
    check(not len(places) or places[-1] < image.size)
    check(listed[1].max(initial=0) <= farthest)
    image[np.unravel_index(places, image.shape)] = listed[1]


def _writer(values: int) -> _RansCoder:
    tokens = np.empty(values, np.uint64)
    return _RansCoder(np.zeros(3, np.uint64), np.zeros(1, np.uint32), tokens)


def _reader(part: bytes) -> _RansCoder:
    words = np.frombuffer(part, "<u4") if len(part) % _WORD_BYTES == 0 else np.zeros(0, "<u4")
    check(len(words) >= _STATE_WORDS)
    registers = np.append(np.zeros(1, np.uint64), words[:_STATE_WORDS].view("<u8"))
    words = np.append(words[_STATE_WORDS:], np.zeros(1, "<u4"))
    return _RansCoder(registers.astype(np.uint64), words.astype(np.uint32), np.zeros(0, np.uint64))


def _written(coder: _RansCoder) -> bytes:
    out = np.empty(2 * len(coder.tokens), np.uint32)
    words = out[_write_words(coder, out) :]
    return coder.registers[1:].astype("<u8").tobytes() + words.astype("<u4").tobytes()

"""Estimates of reflectivities from the ranges and signals of returns.

A reflectivity is nearly gain * signal * range^2. The logarithm of the gain is a constant plus one
entry of each of five learnt tables. The tables' indices are: range; laser and range; laser; signal;
the estimate from the other four tables.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from pointkit.coding.context_mixing import Ints, Words
from pointkit.compiling import inlined
from puck.experts import FINE
from puck.numbers import halves

MAX_VALUE = (1 << 16) - 1
_OCTAVE = 4096
"""Difference of two logarithms whose numbers have the ratio 2."""
_BINS = 400
"""Number of entries of a table of logarithms, with 16 entries per octave."""
_COARSE_BINS, _COARSE = 52, 3
"""Number of entries of a laser's table of logarithms of ranges, 2 ** (4 - _COARSE) per octave."""
_TABLES = 5
_VARIANCE = 1 << 24
"""Integer for a variance of 1 squared octave."""
_FIRST_VARIANCES = np.array([1.0, 0.05, 1.0, 0.05, 0.05])
"""Variances of the entries of the five tables before the first estimate, in squared octaves."""
_LEAST_VARIANCES = tuple(round(_VARIANCE * share) for share in (1e-4, 2e-4, 1e-5, 1e-4, 1e-4))
"""Least variances of the entries of each table, above 0 so that entries adapt to changes."""
_LEAST_NOISE, _MOST_NOISE = _VARIANCE >> 13, _VARIANCE // 25
"""Limits of the variance of the error that no table explains."""
_ROUNDING = round(0.2 * _VARIANCE)
"""Variance of the logarithm of v due to the rounding of v, times v squared."""
_EARLY_GAIN = -81633 << 8
"""Initial constant for reflectivities of 16 bits, from two sensors with early firmware (ranges in
mm)."""


class Gains(NamedTuple):
    logarithms: Ints  # entries of all tables, then the constant, in 2**-20 octaves
    variances: Ints  # of the errors of the entries
    starts: Ints  # first entry of each table, and the constant
    places: Ints  # of the last estimate in the tables, in 1 / 256 entries
    memory: Ints  # last estimate, in 2**-20 octaves; its value; variance of errors
    of_mantissas: Words  # logarithms, see `_tables`
    powers: Words
    farthest: int  # largest reflectivity


def new_gains(lasers: int, farthest: int) -> Gains:
    """Return tables that have learnt nothing yet, for reflectivities of at most `farthest`."""
    entries = np.array([_BINS, lasers * _COARSE_BINS, lasers + 1, _BINS, _BINS])
    variances = np.append(np.repeat(_VARIANCE * _FIRST_VARIANCES, entries), 0).astype(np.int64)
    gains = Gains(
        np.zeros(entries.sum() + 1, np.int64), variances, np.cumsum([0, *entries]),
        np.zeros(_TABLES, np.int64), np.array([0, 0, _VARIANCE // 1000]), *_tables(), farthest,
    )  # fmt: skip
    if farthest == MAX_VALUE:
        gains.logarithms[-1] = _EARLY_GAIN
    return gains


@cache
def _tables() -> tuple[Words, Words]:
    """Return 4096 log2(1 + k / 4096) and 2^15 * 2^(k / 4096), both rounded, for k < 4096."""
    k = np.arange(_OCTAVE) / _OCTAVE
    logarithms, powers = np.rint(_OCTAVE * np.log2(1 + k)), np.rint(2**15 * 2**k)
    return logarithms.astype(np.int32), powers.astype(np.int32)


@inlined
def _logarithm(gains: Gains, value: int) -> int:
    octave = halves(value - 1) >> 1
    place = np.uint64(((value << 12) >> octave) - _OCTAVE)
    return octave * _OCTAVE + int(gains.of_mantissas[place])


@inlined
def _power(gains: Gains, logarithm: int) -> int:
    logarithm = min(max(logarithm, -3 * _OCTAVE), 24 * _OCTAVE - 1)
    mantissa = int(gains.powers[np.uint64(logarithm & (_OCTAVE - 1))])
    return max((mantissa << ((logarithm >> 12) + 4)) >> 15, 1)


@inlined
def estimated(gains: Gains, distance: int, signal: int, laser: int) -> int:
    """Return an estimate of a reflectivity from range and signal, in units of 1 / FINE.

    The estimate is 0 if the range or the signal is 0. The tables' indices are kept for
    `learn_estimate`.
    """
    if distance == 0 or signal == 0:
        return 0
    places, starts = gains.places, gains.starts
    distance, signal = _logarithm(gains, distance), _logarithm(gains, signal)
    places[0] = distance
    places[1] = (starts[1] + laser * _COARSE_BINS << 8) + (distance >> _COARSE)
    places[2] = starts[2] + laser << 8
    places[3] = (starts[3] << 8) + signal
    _start_range(gains)
    places[4], total = _total(gains, distance, signal, laser)
    gains.memory[0] = total
    estimate = _power(gains, total >> 8)
    gains.memory[1] = estimate // FINE
    return _within(gains, estimate)


@inlined
def estimated_only(gains: Gains, distance: int, signal: int, laser: int) -> int:
    """Return the estimate of `estimated` without changing an array, which is faster."""
    has_both = distance > 0 and signal > 0
    distance, signal = _logarithm(gains, max(distance, 1)), _logarithm(gains, max(signal, 1))
    _, total = _total(gains, distance, signal, laser)
    estimate = _within(gains, _power(gains, total >> 8))
    return estimate if has_both else 0


@inlined
def _total(gains: Gains, distance: int, signal: int, laser: int) -> tuple[int, int]:
    """Return the index in the last table, and an estimate, from logarithms of range and signal."""
    starts = gains.starts
    total = int(gains.logarithms[starts[5]]) + (signal + 2 * distance << 8)
    total += _gain(gains, distance)
    total += _gain(gains, (starts[1] + laser * _COARSE_BINS << 8) + (distance >> _COARSE))
    total += int(gains.logarithms[starts[2] + laser]) + _gain(gains, (starts[3] << 8) + signal)
    last = (starts[4] << 8) + min(max(total >> 8, 0), (_BINS - 2) << 8)
    return last, total + _gain(gains, last)


@inlined
def _within(gains: Gains, estimate: int) -> int:
    if gains.farthest == MAX_VALUE:  # a larger value has lost its highest bits
        return max(estimate % (FINE << 16), 1)
    return min(estimate, FINE * gains.farthest)


@inlined
def _start_range(gains: Gains) -> None:
    """Initialise an unlearnt entry of the table of ranges with the learnt entry beside it."""
    sums, variances, first = gains.logarithms, gains.variances, gains.places[0] >> 8
    low, high = variances[first] == _VARIANCE, variances[first + 1] == _VARIANCE
    if low and not high:
        sums[first], variances[first] = sums[first + 1], _VARIANCE // 4
    if high and not low:
        sums[first + 1], variances[first + 1] = sums[first], _VARIANCE // 4


@inlined
def _gain(gains: Gains, place: int) -> int:
    share, sums, index = place & 255, gains.logarithms, np.uint64(place >> 8)
    gain: int = (sums[index] * (256 - share) + sums[index + np.uint64(1)] * share) >> 8
    return gain


@inlined
def learn_estimate(gains: Gains, value: int) -> None:
    """Correct the table entries that the last call of `estimated` used, given the true `value`.

    The correction of an entry depends on the entry's variance, as in a Kalman filter without
    covariances.
    """
    places, sums, variances, memory = gains.places, gains.logarithms, gains.variances, gains.memory
    if gains.farthest == MAX_VALUE:
        value += max(memory[1] - value + (1 << 15), 0) >> 16 << 16
    elif value == gains.farthest:
        return
    error = (_logarithm(gains, value) << 8) - memory[0]
    constant = gains.starts[5]
    if sums[constant] == 0:
        sums[constant] = error
        return
    if gains.farthest == MAX_VALUE and abs(error) > _OCTAVE << 6:
        return
    rounding = _ROUNDING // (value * value)
    total = memory[2] + rounding
    for k in range(_TABLES):
        place, share = places[k] >> 8, places[k] & 255
        total += variances[place] * (256 - share) * (256 - share) >> 16
        total += variances[place + 1] * share * share >> 16
    size = min(abs(error) >> 8, 1 << 14)
    memory[2] += (
        min(max((size * size >> 1) - rounding, _LEAST_NOISE), _MOST_NOISE) - memory[2]
    ) >> 6
    limit = 5 << 7 + (halves(total) >> 2)  # about 2.5 standard deviations
    error = min(max(error, -limit), limit)
    inverse = (1 << 40) // total
    for k in range(_TABLES):
        for after in range(2):
            place, share = (places[k] >> 8) + after, places[k] & 255
            variance = variances[place] * (share if after else 256 - share) >> 8
            gain = variance * inverse >> 24
            sums[place] += error * gain >> 16
            left = variances[place] - (variance * gain >> 16)
            variances[place] = max(left, _LEAST_VARIANCES[k])

"""Coding of values with Laplace distributions, whose frequencies are rounded as the authors' are.

The frequency of each of the possible values is at least 1 of 2^16; the rest, 2^16 minus the number
of values, is distributed. Frequencies are computed where the range coder needs them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pcc_networks.exponential import exponential
from pcc_networks.polopcac.fixed_point import STEP, Floats
from pcc_networks.range_coder import (
    CDF_BITS,
    MAX_RANGE,
    START_BITS,
    Bytes,
    check_end,
    end_of_bits,
    first_value,
    most_bytes,
    narrowed,
    position,
    read_settled,
    settled_bits,
)
from pointkit.compiling import compiled

Values = NDArray[np.int32]
SPREAD = 32.0
"""Scale of a distribution whose logarithm the network predicts as 0."""
_MOST_LOG = 10.0
"""Largest magnitude of a predicted logarithm; frequencies then increase strictly."""


def laplace(outputs: Floats, channels: int, peak: float) -> tuple[Floats, Floats]:
    """Return the locations and scales of the distributions that the network predicts.

    Parameters
    ----------
    outputs
        Outputs (n, 6) of the network, in steps.
    channels
        Number of values of a point that are coded, up to 3.
    peak
        Size of values: an output o stands for the value ``(o + 0.5) * peak``.

    Returns
    -------
    tuple
        Locations (n * channels,) and scales (n * channels,).
    """
    locations = (outputs[:, :channels] * STEP + 0.5) * peak
    scales = np.ascontiguousarray(outputs[:, 3 : 3 + channels]).ravel()
    _scale(scales)
    return np.ascontiguousarray(locations).ravel(), scales


def encode_values(values: Values, locations: Floats, scales: Floats, levels: int) -> bytes:
    """Encode values (n,) from 0 to ``levels - 1`` with a distribution for each."""
    out = np.zeros(most_bytes(len(values)), np.uint8)
    return out[: _encode(values, locations, scales, levels, out)].tobytes()


def decode_values(data: bytes, locations: Floats, scales: Floats, levels: int) -> Values:
    """Decode the values (n,) that were encoded with these distributions.

    Raises InputError if the data are damaged.
    """
    values = np.zeros(len(locations), np.int32)
    read = _decode(np.frombuffer(data, np.uint8), locations, scales, levels, values)
    check_end(data, read)
    return values


@compiled
def cumulative(value: int, location: float, scale: float, levels: int) -> int:
    """Return the frequency of all values below a value from 0 to `levels`, of 2^16."""
    if value <= 0:
        return 0
    if value >= levels:
        return 1 << CDF_BITS
    distance = (value - 0.5 - location) / scale
    tail = 0.5 * exponential(-abs(distance))
    share = tail if distance < 0.0 else 1.0 - tail
    return math.floor(share * ((1 << CDF_BITS) - levels) + 0.5) + value


@compiled
def _scale(logarithms: Floats) -> None:
    for k in range(len(logarithms)):
        log = min(max(logarithms[k] * STEP, -_MOST_LOG), _MOST_LOG)
        power = exponential(-abs(log))
        logarithms[k] = SPREAD * power if log < 0.0 else SPREAD / power


@compiled
def _encode(values: Values, locations: Floats, scales: Floats, levels: int, out: Bytes) -> int:
    low, high, pending, at = 0, MAX_RANGE, 0, 0
    for row in range(len(values)):
        first = cumulative(values[row], locations[row], scales[row], levels)
        end = cumulative(values[row] + 1, locations[row], scales[row], levels)
        low, high = narrowed(low, high, first, end)
        at, pending, low, high = settled_bits(out, at, pending, low, high)
    return end_of_bits(out, at, pending, low)


@compiled
def _decode(data: Bytes, locations: Floats, scales: Floats, levels: int, values: Values) -> int:
    low, high, value, at = 0, MAX_RANGE, first_value(data), START_BITS
    for row in range(len(values)):
        if at - START_BITS > 8 * len(data):
            break
        count = position(low, high, value)
        symbol, upper, first, end = 0, levels, 0, 1 << CDF_BITS
        while symbol + 1 < upper:
            middle = (symbol + upper) // 2
            below = cumulative(middle, locations[row], scales[row], levels)
            if below <= count:
                symbol, first = middle, below
            else:
                upper, end = middle, below
        values[row] = symbol
        low, high = narrowed(low, high, first, end)
        at, value, low, high = read_settled(data, at, value, low, high)
    return at

"""The conditional entropy model: Laplace distributions of integers, as a fixed set of tables.

A value of the latent has a location and a scale. Both come from the hyper-decoder as whole numbers
of 1 / `UNITS`; they choose one of 64 scales and one of 16 places between two integers, and so one
of 1,024 tables of whole numbers. The tables are part of the format: they are made with a correctly
rounded exponential and with multiplications, so that every machine has the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from decimal import Context, Decimal
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from puckbench.codecs.learned.entropy_bottleneck import LEAST, Table
from puckbench.codecs.learned.pcgcv1.occupied_blocks import rows_of

UNIT_BITS = 12
UNITS = 2**UNIT_BITS
PLACE_BITS = 4
PLACES = 2**PLACE_BITS
SCALES = 64
LEAST_SCALE, MOST_SCALE = 2.0**-5, 2.0**5
_TOTAL_BITS = 22
_ESCAPE = 4
"""Frequency of what lies outside a table, 2**-20 of the whole."""
_REACH = 13.9
"""20 ln 2: a Laplace distribution keeps 2**-20 beyond so many scales."""

Whole = NDArray[np.int64]


class Chosen(NamedTuple):
    """For each value the number of its table and the integer that the table is centred on."""

    table: NDArray[np.uint16]
    centre: NDArray[np.int32]

    def rows(self, blocks: NDArray[np.bool_]) -> Chosen:
        """Those of blocks that count: see `rows_of`."""
        return Chosen(rows_of(self.table, blocks), rows_of(self.centre, blocks))


Join = Callable[[Sequence[NDArray[Any]]], NDArray[Any]]


def joined(join: Join, parts: Sequence[Chosen]) -> Chosen:
    """Several parts as one, joined by a function of arrays."""
    return Chosen(join([part.table for part in parts]), join([part.centre for part in parts]))


def choose(location: Whole, scale: Whole) -> Chosen:
    """The tables of values with locations and scales in whole numbers of 1 / `UNITS`."""
    step = UNIT_BITS - PLACE_BITS
    place = (location + (1 << step - 1)) >> step
    level = np.searchsorted(_borders(), scale)
    table = level << PLACE_BITS | place & (PLACES - 1)
    return Chosen(table.astype(np.uint16), (place >> PLACE_BITS).astype(np.int32))


def _scale(level: Decimal) -> Decimal:
    """The scale of a level; levels are geometric."""
    low, high = Decimal(LEAST_SCALE), Decimal(MOST_SCALE)
    return low * ((high / low).ln(_CONTEXT) * level / (SCALES - 1)).exp(_CONTEXT)


_CONTEXT = Context(prec=40)
"""decimal's exponential is correctly rounded, unlike a C library's, which differ by machine."""


@cache
def _borders() -> Whole:
    """Scales between two levels, in whole numbers of 1 / `UNITS`."""
    halves = (Decimal(level) + Decimal("0.5") for level in range(SCALES - 1))
    return np.array([int((_scale(half) * UNITS).to_integral_value()) for half in halves])


@cache
def table(number: int) -> Table:
    """The table that `choose` numbers so; its integers count from the centre."""
    level, place = number >> PLACE_BITS, number & (PLACES - 1)
    scale = float(_scale(Decimal(level)))
    reach = int(scale * _REACH) + 1
    # edges of the integers' unit intervals, as distances from the location in 1 / PLACES
    edges = np.arange(-reach, reach + 3) * PLACES - PLACES // 2 - place
    tail = _powers(level, np.abs(edges).max())[np.abs(edges)] / 2
    below = np.where(edges < 0, tail, 1 - tail)
    masses = np.rint(np.diff(below) * 2**_TOTAL_BITS).astype(np.int32)
    return Table(-reach, np.append(np.maximum(masses, 1), _ESCAPE).astype(np.int32))


def _powers(level: int, most: int) -> NDArray[np.float64]:
    """exp(-k / (PLACES * scale)) for k from 0 to `most`, by multiplication alone."""
    ratio = float((-1 / (PLACES * _scale(Decimal(level)))).exp(_CONTEXT))
    return np.cumprod(np.append(1.0, np.full(most, ratio)))


def likelihood(latent: Tensor, location: Tensor, scale: Tensor) -> Tensor:
    """Probability of the unit interval around each value, for training; all of one shape."""
    scale = scale.clamp_min(LEAST_SCALE)
    distance = (latent - location).abs()
    mass = _below(0.5 - distance, scale) - _below(-0.5 - distance, scale)
    return mass.clamp_min(LEAST)


def _below(values: Tensor, scale: Tensor) -> Tensor:
    tail = (-values.abs() / scale).exp() / 2
    return torch.where(values < 0, tail, 1 - tail)

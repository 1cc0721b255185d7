"""Real coordinates to the integer grid that G-PCC codes, and back."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.cloud import Floats
from puckbench.errors import InputError

Rounding = Literal["nearest", "truncate"]
ROUNDINGS: tuple[Rounding, ...] = ("nearest", "truncate")
MOST_BITS = 21
"""Bits of a coordinate, at most: the bounding box of the reference's default level."""
_FARTHEST = 2.0**30
"""Coordinates beyond it do not fit the origin that a stream signals."""


class Frame(NamedTuple):
    """Length of the input grid's step, and the point of the input that lies at its origin."""

    unit: float = 1.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Quantised(NamedTuple):
    """Grid positions (n, 3) from 0, int64, and the one (3,) that must be added to them."""

    positions: NDArray[np.int64]
    origin: NDArray[np.int64]


def frame_of(points: Floats, unit: float, scale: float) -> Frame:
    """The frame of the input itself, or one moved to the cloud when that is too far away."""
    if np.abs(points).max() < _FARTHEST * unit / max(scale, 1.0):
        return Frame(unit)
    x, y, z = points.min(axis=0)
    return Frame(unit, (float(x), float(y), float(z)))


def quantised(points: Floats, frame: Frame, scale: float, rounding: Rounding) -> Quantised:
    """Points (n, 3) on the grid whose step is unit / scale.

    ``nearest`` rounds once, to that grid. ``truncate`` is what TMC13 does to the floating-point
    file that it reads: towards zero on the unit's grid, then round in single precision.
    InputError when the cloud spans more than `MOST_BITS` bits.
    """
    with np.errstate(over="ignore"):
        units = (points - np.asarray(frame.offset)) / frame.unit
        widest = float(np.ptp(units, axis=0).max()) * scale
    if not widest < 2**MOST_BITS - 1:
        raise InputError(f"the cloud spans more than {MOST_BITS} bits at scale {scale:g}")
    if rounding == "nearest":
        rounded = _half_away_from_zero(units * scale)
    else:
        truncated = np.trunc(units).astype(np.float32)
        rounded = _half_away_from_zero((truncated * np.float32(scale)).astype(np.float64))
    whole = rounded.astype(np.int64)
    origin = whole.min(axis=0)
    return Quantised(whole - origin, origin)


def _half_away_from_zero(values: Floats) -> Floats:
    return np.trunc(values + np.copysign(np.nextafter(0.5, 0), values))


def in_frame(units: Floats, frame: Frame) -> Floats:
    """Points (m, 3) given in units, in the coordinates of the input."""
    if frame == Frame():
        return units
    return np.asarray(units * frame.unit + np.asarray(frame.offset))

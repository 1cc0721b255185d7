"""Quantisation of real coordinates to the integer grid that G-PCC codes, and back."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import NARROWER, InputError
from puckbench.geometry.cloud import Floats, bounds

Rounding = Literal["nearest", "truncate"]
ROUNDINGS: tuple[Rounding, ...] = ("nearest", "truncate")
MOST_BITS = 21
"""Bits of a coordinate, at most: the bounding box of the reference's default level."""
_FARTHEST = 2.0**30
"""Coordinates beyond it do not fit the origin that a stream signals."""


class Frame(NamedTuple):
    """Step of the input's grid, and the point of the input that is its origin."""

    unit: float = 1.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Quantised(NamedTuple):
    """Grid positions (n, 3) int64 from 0 on, and the origin (3,) to be added to them."""

    positions: NDArray[np.int64]
    origin: NDArray[np.int64]


def frame_of(points: Floats, unit: float, scale: float) -> Frame:
    """The input's own frame, or one moved to a cloud that is too far away."""
    ends = bounds(points)
    if np.abs(ends).max() < _FARTHEST * unit / max(scale, 1.0):
        return Frame(unit)
    x, y, z = ends[0]
    return Frame(unit, (float(x), float(y), float(z)))


def quantised(points: Floats, frame: Frame, scale: float, rounding: Rounding) -> Quantised:
    """Quantise points to the grid whose step is unit / scale.

    Parameters
    ----------
    points
        (n, 3) coordinates.
    frame
        Unit and offset.
    scale
        Grid positions per unit.
    rounding
        ``nearest`` rounds once, to that grid. ``truncate`` does what TMC13 does with floating-point
        files: towards zero on the unit's grid, then rounding in single precision.

    Raises
    ------
    InputError
        If the cloud spans more than `MOST_BITS` bits.
    """
    with np.errstate(over="ignore"):
        units = points if frame == Frame() else (points - frame.offset) / frame.unit
        ends = bounds(units)
        widest = float(np.ptp(ends, axis=0).max()) * scale
    if not widest < 2**MOST_BITS - 1:
        raise InputError(f"the cloud spans more than {MOST_BITS} bits at scale {scale:g}{NARROWER}")
    positions = _rounded(units, scale, rounding)
    origin = _rounded(ends, scale, rounding)[0]  # rounding keeps the order
    positions -= origin
    return Quantised(positions, origin)


def _rounded(units: Floats, scale: float, rounding: Rounding) -> NDArray[np.int64]:
    """Halves go away from zero, as in C's ``round``."""
    if rounding == "nearest":
        scaled = units * scale
    else:
        scaled = (np.trunc(units).astype(np.float32) * np.float32(scale)).astype(np.float64)
    scaled += np.copysign(np.nextafter(0.5, 0), scaled)
    return scaled.astype(np.int64)


def in_frame(units: Floats, frame: Frame) -> Floats:
    """Points (m, 3) given in units, in the coordinates of the input.

    InputError for a frame in which double precision cannot hold them.
    """
    if frame == Frame():
        return units
    with np.errstate(over="ignore", invalid="ignore"):
        points = np.asarray(units * frame.unit + np.asarray(frame.offset))
    if not np.isfinite(points).all():
        raise InputError("the stream is damaged (its frame)")
    return points

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
"""Maximum bits of a coordinate: the largest bounding box of the profiles' default level."""
_FARTHEST = 2.0**30
"""Coordinates beyond this do not fit in the sequence origin of a stream."""


class InputGrid(NamedTuple):
    """The grid of the input coordinates: its step and the position of its origin."""

    unit: float = 1.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


DEFAULT_GRID = InputGrid()


class Quantised(NamedTuple):
    """Positions (n, 3) int64 of at least 0, and the origin (3,) int64 to add to them."""

    positions: NDArray[np.int64]
    origin: NDArray[np.int64]


def input_grid(points: Floats, unit: float, scale: float) -> InputGrid:
    """Return the grid for a cloud; its origin moves only if the cloud is too far from zero."""
    ends = bounds(points)
    if np.abs(ends).max() < _FARTHEST * unit / max(scale, 1.0):
        return InputGrid(unit)
    x, y, z = ends[0]
    return InputGrid(unit, (float(x), float(y), float(z)))


def quantise(
    points: Floats,
    grid: InputGrid = DEFAULT_GRID,
    scale: float = 1.0,
    rounding: Rounding = "nearest",
) -> Quantised:
    """Quantise points to a grid with the step ``grid.unit / scale``.

    Parameters
    ----------
    points
        (n, 3) coordinates.
    grid
        Grid of the input.
    scale
        Steps of the quantised grid per step of the input grid.
    rounding
        ``nearest`` rounds once. ``truncate`` does what TMC13 does with floating-point files: it
        truncates to the input grid, then rounds in single precision.

    Raises
    ------
    InputError
        If the cloud spans more than `MOST_BITS` bits.
    """
    with np.errstate(over="ignore"):
        units = points if grid == DEFAULT_GRID else (points - grid.offset) / grid.unit
        ends = bounds(units)
        widest = float(np.ptp(ends, axis=0).max()) * scale
    if not widest < 2**MOST_BITS - 1:
        raise InputError(f"the cloud spans more than {MOST_BITS} bits at scale {scale:g}{NARROWER}")
    positions = _rounded(units, scale, rounding)
    origin = _rounded(ends, scale, rounding)[0]  # rounding keeps the order
    positions -= origin
    return Quantised(positions, origin)


def _rounded(units: Floats, scale: float, rounding: Rounding) -> NDArray[np.int64]:
    """Halves are rounded away from zero, as by C's ``round``."""
    if rounding == "nearest":
        scaled = units * scale
    else:
        scaled = (np.trunc(units).astype(np.float32) * np.float32(scale)).astype(np.float64)
    scaled += np.copysign(np.nextafter(0.5, 0), scaled)
    return scaled.astype(np.int64)


def input_coordinates(units: Floats, grid: InputGrid) -> Floats:
    """Convert points (m, 3) from steps of the input grid to input coordinates.

    Raises InputError if the results are not finite.
    """
    if grid == DEFAULT_GRID:
        return units
    with np.errstate(over="ignore", invalid="ignore"):
        points = np.asarray(units * grid.unit + np.asarray(grid.offset))
    if not np.isfinite(points).all():
        raise InputError("the stream is damaged (its grid)")
    return points

"""The grid of a cloud's coordinates, and a container for it, since G-PCC cannot signal the grid.

A container is::

    4 bytes   "PBGP"
    1 byte    1 if a grid follows, otherwise 0
    32 bytes  grid, if any: step, and origin x, y, z (float64, little-endian)
    stream

A bare stream, as TMC13 writes it, starts with the payload type 0 and the payload's length in four
bytes.
"""

from __future__ import annotations

import struct
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import NARROWER, InputError
from pointkit.geometry.cloud import Floats, bounds

Rounding = Literal["nearest", "truncate"]
MOST_BITS = 21
"""Maximum number of bits of a coordinate, as in the default level of the standard's profiles."""
_FARTHEST = 2.0**30
"""Largest coordinate in steps, since the origin that a stream states cannot be farther away."""
MAGIC = b"PBGP"
_GRID = struct.Struct("<4d")


class InputGrid(NamedTuple):
    """Grid on which the coordinates of a cloud lie before they are scaled.

    Attributes
    ----------
    unit
        Step of the grid, in the unit of the coordinates.
    offset
        Origin of the grid, in the unit of the coordinates.
    """

    unit: float = 1.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


DEFAULT_GRID = InputGrid()


class Quantised(NamedTuple):
    """Quantised points, as the encoders take them.

    Attributes
    ----------
    positions
        Integer coordinates (n, 3) in grid steps, none of them negative.
    origin
        Integers (3,), in grid steps, which a decoder adds to the positions.
    """

    positions: NDArray[np.int64]
    origin: NDArray[np.int64]


def input_grid(points: Floats, unit: float, scale: float) -> InputGrid:
    """Return a grid for coordinates that will be coded in steps of ``unit / scale``.

    Parameters
    ----------
    points
        Coordinates (n, 3).
    unit
        Step of the returned grid, in the unit of the coordinates.
    scale
        Number of coded steps per grid step.

    Returns
    -------
    InputGrid
        The grid. Its offset is zero or, if the coordinates are too large for a stream, the points'
        minimum.
    """
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
    """Round points to the integer coordinates that the encoders take.

    The step of the result is ``grid.unit / scale``.

    Parameters
    ----------
    points
        Coordinates (n, 3).
    grid
        The grid of the coordinates. By default, its step is 1 and its offset zero.
    scale
        Number of coded steps per grid step. For example, 100 codes metres in steps of 1 cm.
    rounding
        ``nearest`` rounds to the nearest step. ``truncate`` first truncates to multiples of
        ``grid.unit``, then rounds in single precision, as TMC13 does for floating-point files.

    Returns
    -------
    Quantised
        Positions (n, 3), of which several may be equal, and the origin (3,) to pass to the encoder.

    Raises
    ------
    InputError
        The cloud spans 2^21 - 1 steps or more.
    """
    with np.errstate(over="ignore"):
        units = points if grid == DEFAULT_GRID else (points - grid.offset) / grid.unit
        ends = bounds(units)
        widest = float(np.ptp(ends, axis=0).max()) * scale
    if not widest < 2**MOST_BITS - 1:
        raise InputError(f"the cloud spans more than {MOST_BITS} bits at scale {scale:g}{NARROWER}")
    positions = _rounded(units, scale, rounding)
    origin = _rounded(ends, scale, rounding)[0]  # rounding preserves order
    positions -= origin
    return Quantised(positions, origin)


def _rounded(units: Floats, scale: float, rounding: Rounding) -> NDArray[np.int64]:
    if rounding == "nearest":
        scaled = units * scale
    else:
        scaled = (np.trunc(units).astype(np.float32) * np.float32(scale)).astype(np.float64)
    scaled += np.copysign(np.nextafter(0.5, 0), scaled)
    return scaled.astype(np.int64)


def input_coordinates(units: Floats, grid: InputGrid) -> Floats:
    """Return decoded positions, converted from grid steps to the cloud's coordinates.

    Parameters
    ----------
    units
        Positions (m, 3) in grid steps.
    grid
        The grid of the coordinates.

    Returns
    -------
    ndarray
        Coordinates (m, 3) in the unit of the cloud.

    Raises
    ------
    InputError
        A coordinate is not finite, since the grid of a damaged stream is not.
    """
    if grid == DEFAULT_GRID:
        return units
    with np.errstate(over="ignore", invalid="ignore"):
        points = np.asarray(units * grid.unit + np.asarray(grid.offset))
    if not np.isfinite(points).all():
        raise InputError("the stream is damaged (its grid)")
    return points


class Unwrapped(NamedTuple):
    """A bare G-PCC stream, and the grid of the cloud's coordinates."""

    stream: bytes
    grid: InputGrid


def wrap(stream: bytes, grid: InputGrid) -> bytes:
    """Return a container of a bare stream and the grid of the cloud's coordinates.

    The default grid takes no bytes.
    """
    if grid == DEFAULT_GRID:
        return MAGIC + b"\0" + stream
    return MAGIC + b"\1" + _GRID.pack(grid.unit, *grid.offset) + stream


def unwrap(data: bytes) -> Unwrapped:
    """Return the bare stream and the grid of a container.

    A bare stream is accepted, too, and has the default grid.

    Raises
    ------
    InputError
        The bytes begin like neither, or the grid is damaged.
    """
    if not data.startswith(MAGIC):
        if not data.startswith(b"\0\0\0"):
            raise InputError("not a G-PCC stream")
        return Unwrapped(data, DEFAULT_GRID)
    start = len(MAGIC) + 1
    if data[start - 1 : start] == b"\0":
        return Unwrapped(data[start:], DEFAULT_GRID)
    if data[start - 1 : start] != b"\1" or len(data) < start + _GRID.size:
        raise InputError("the stream's first bytes are damaged")
    unit, *offset = _GRID.unpack_from(data, start)
    if not (0 < unit < np.inf and np.isfinite(offset).all()):
        raise InputError("the stream's first bytes are damaged (the grid is not finite)")
    x, y, z = offset
    return Unwrapped(data[start + _GRID.size :], InputGrid(unit, (x, y, z)))

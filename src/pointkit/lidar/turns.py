"""One revolution of a spinning sensor as images, and the arrangement of firings in them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats

CENTIDEGREES = 36000
MAX_AZIMUTH_STEPS = 1 << 16
MAX_LASERS = 128
MAX_COLUMNS = 1 << 14
"""Limit of the columns of a turn; a Puck at its lowest rotation rate has 3,617."""
MAX_PIXELS = 1 << 20
MAX_RANGE = (1 << 24) - 1
"""Largest range in an image of 32 bits, in quanta."""


_Value = TypeVar("_Value", bound=np.generic)
Ranges = NDArray[np.uint16 | np.uint32]


@dataclass(frozen=True)
class Layout:
    """Arrangement of a sensor's firings in images of columns by lasers.

    A column is one firing of all lasers.

    Parameters
    ----------
    order
        Numbers of the lasers, from the lowest elevation to the highest.
    columns_per_block
        Number of successive columns that share one reported azimuth; these form a block. It is two
        for a VLP-16.
    blocks_per_time
        Number of successive blocks that share one reported time; these form a packet.
    kinds
        Number of returns that the sensor reports for each beam: 1, or 2 in dual return mode.
    azimuth_steps
        Number of units of azimuth in a revolution. By default, it is 36,000 units of 0.01 degrees;
        for an Ouster, it is the number of columns.
    shifts
        Number of columns by which coders move the values of each laser, so that all values of a
        column have nearly one azimuth although the lasers point to different azimuths. Empty: no
        value is moved.

    Raises
    ------
    ValueError
        A value is out of its range, or `order` is no permutation of the lasers.
    """

    order: tuple[int, ...]
    columns_per_block: int = 1
    blocks_per_time: int = 1
    kinds: int = 1
    azimuth_steps: int = CENTIDEGREES
    shifts: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if sorted(self.order) != list(range(len(self.order))) or not self.order:
            raise ValueError("the order of the lasers is no permutation")
        if len(self.order) > MAX_LASERS or self.kinds not in (1, 2):
            raise ValueError(f"at most {MAX_LASERS} lasers and two kinds")
        if not 1 <= self.columns_per_block <= 255 or not 1 <= self.blocks_per_time <= 255:
            raise ValueError("columns of a block and blocks of a time are 1 to 255")
        if not 1 <= self.azimuth_steps <= MAX_AZIMUTH_STEPS:
            raise ValueError(f"azimuth steps of a revolution are 1 to {MAX_AZIMUTH_STEPS}")
        if len(self.shifts) not in (0, self.lasers) or any(
            abs(shift) >= MAX_COLUMNS for shift in self.shifts
        ):
            raise ValueError(f"shifts are less than {MAX_COLUMNS} columns, of each laser or none")

    @property
    def lasers(self) -> int:
        """Number of lasers."""
        return len(self.order)

    @property
    def max_blocks(self) -> int:
        """Largest number of blocks in a revolution."""
        columns = min(MAX_COLUMNS, MAX_PIXELS // self.lasers)
        return max(columns // self.columns_per_block, 1)


@dataclass(frozen=True)
class Turn:
    """The firings of one turn, i.e. one revolution of the sensor, as images.

    The lasers are in the order of their numbers.

    Parameters
    ----------
    ranges
        Ranges, (kinds of return, columns, lasers), uint16 or uint32, in the sensor's units, at most
        `MAX_RANGE`; 0 for no return.
    azimuths
        Azimuth of each block, (blocks,), uint16, in the layout's azimuth steps. Azimuths increase
        in the direction of rotation.
    times
        Time of each packet, (ceil(blocks / blocks_per_time),), uint32, in microseconds of the
        sensor's clock; None if unknown.
    reflectivities
        Reflectivities, uint8, in the shape of `ranges`; None if unknown.
    """

    ranges: Ranges
    azimuths: NDArray[np.uint16]
    times: NDArray[np.uint32] | None = None
    reflectivities: NDArray[np.uint8] | None = None

    @property
    def returns(self) -> int:
        """Number of returns; in dual return mode, the second return of a beam does not count."""
        return int(np.count_nonzero(self.ranges[0]))


def check_turn(turn: Turn, layout: Layout) -> None:
    """Raise InputError unless the arrays of a turn have the shapes and types of a layout."""
    blocks = len(turn.azimuths)
    shape = (layout.kinds, blocks * layout.columns_per_block, layout.lasers)
    arrays: list[tuple[str, Any, tuple[int, ...], str]] = [
        ("ranges", turn.ranges, shape, "uint32" if has_wide_ranges(turn) else "uint16"),
        ("azimuths", turn.azimuths, (blocks,), "uint16"),
        ("times", turn.times, (-(-blocks // layout.blocks_per_time),), "uint32"),
        ("reflectivities", turn.reflectivities, shape, "uint8"),
    ]
    for name, values, expected, kind in arrays:
        if values is not None and (values.shape != expected or values.dtype != kind):
            actual = f"{values.dtype} {values.shape}"
            raise InputError(f"{name} of a turn are {actual}, not {kind} {expected}")
    if not 0 < blocks <= layout.max_blocks:
        raise InputError(f"a turn of {blocks} blocks (1 to {layout.max_blocks})")
    if has_wide_ranges(turn) and turn.ranges.max(initial=0) > MAX_RANGE:
        raise InputError(f"ranges of a turn exceed {MAX_RANGE} quanta")


def by_elevation(values: NDArray[_Value], layout: Layout) -> NDArray[_Value]:
    """Sort the lasers of an image by elevation, after moving their values by the layout's shifts.

    Parameters
    ----------
    values
        Image, (kinds of return, columns, lasers), with the lasers in the order of their numbers.
    layout
        The layout, which has the order and the shifts.

    Returns
    -------
    array
        Image of the same shape.
    """
    if not layout.shifts:
        return values[..., list(layout.order)]
    return _flat(values)[:, _places(layout, *values.shape[1:])].reshape(values.shape)


def by_laser(values: NDArray[_Value], layout: Layout) -> NDArray[_Value]:
    """Undo `by_elevation`: return an image with the lasers in the order of their numbers."""
    if not layout.shifts:
        return values.take(np.argsort(layout.order), axis=2)
    original = np.empty(values.shape, values.dtype)
    _flat(original)[:, _places(layout, *values.shape[1:])] = _flat(values)
    return original


def _flat(values: NDArray[_Value]) -> NDArray[_Value]:
    return values.reshape(len(values), -1)


@lru_cache(maxsize=8)
def _places(layout: Layout, columns: int, lasers: int) -> NDArray[np.intp]:
    """Return, for each value of `by_elevation`'s result, its flat index in the input."""
    order = np.asarray(layout.order)
    shifted = np.arange(columns)[:, None] - np.asarray(layout.shifts)[order]
    return np.asarray(shifted % columns * lasers + order).ravel()


def has_wide_ranges(turn: Turn) -> bool:
    """Return whether the ranges of a turn have 32 bits; otherwise, they have 16 bits."""
    return turn.ranges.dtype == np.uint32


def clock_steps(times: Floats, hour: float) -> Floats:
    """Return the steps between successive times of a clock that restarts periodically.

    Of the steps that are possible, the smallest in absolute value is returned.

    Parameters
    ----------
    times
        Times, (n,).
    hour
        Period of the clock, in the unit of the times.

    Returns
    -------
    array
        Steps, (n - 1,).
    """
    steps: Floats = np.mod(np.diff(times) + hour / 2, hour) - hour / 2
    return steps


def elapsed(times: Floats, hour: float) -> Floats:
    """Return the time since the first of successive times of a clock that restarts periodically.

    Parameters
    ----------
    times, hour
        As for `clock_steps`.

    Returns
    -------
    array
        Elapsed times, (n,), in the unit of the times; the first is 0.
    """
    return np.append(0.0, np.cumsum(clock_steps(times, hour)))

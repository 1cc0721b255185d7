"""Compiled functions that compute with points on the rays of a spinning sensor, one by one.

Functions `fill_...` write their results to their last arguments. Points (n, 3) and coordinates
(3, n) are in metres. Ranges are in units, whose length is part of the `lines` of
`puck.clouds.rays.Rays`. `rings` and `azimuths` (n,) are the number of the laser that measured each
point, and the number of the azimuth step; `cosines` and `sines` are those of each azimuth step.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.context_mixing import Ints
from pointkit.compiling import compiled, compiled_in_place
from pointkit.geometry.cloud import Floats

Rows = NDArray[np.integer[Any]]

_FULL_TURN = 2 * np.pi


@compiled_in_place
def fill_coordinates(
    lines: Floats, cosines: Floats, sines: Floats, rings: Rows, azimuths: Ints, ranges: Floats,
    coordinates: Floats,
) -> None:  # fmt: skip
    """Compute x, y and z of points on the rays, where `ranges` (n,) are the points' ranges."""
    for i in range(len(rings)):
        line, far = lines[rings[i]], ranges[i]
        cosine, sine = cosines[azimuths[i]], sines[azimuths[i]]
        along, side = line[0] + line[3] * far, line[1] + line[4] * far
        coordinates[0, i] = along * cosine - side * sine
        coordinates[1, i] = along * sine + side * cosine
        coordinates[2, i] = line[2] + line[5] * far


@compiled_in_place
def fill_refined_ranges(
    lines: Floats, cosines: Floats, sines: Floats, rings: Rows, azimuths: Ints,
    values: NDArray[np.float32], is_x: NDArray[np.bool_], ranges: Floats,
) -> None:  # fmt: skip
    """Compute the range of each point, in units, from one of its coordinates.

    Parameters
    ----------
    lines, cosines, sines, rings, azimuths
        The rays on which the points are, as described above.
    values
        The known coordinate of each point, (n,), m.
    is_x
        Whether the known coordinate is x, (n,); otherwise, it is y.
    ranges
        Receives the ranges, (n,), which are not rounded.
    """
    for i in range(len(rings)):
        line = lines[rings[i]]
        cosine, sine = cosines[azimuths[i]], sines[azimuths[i]]
        if is_x[i]:
            first, more = line[0] * cosine - line[1] * sine, line[3] * cosine - line[4] * sine
        else:
            first, more = line[0] * sine + line[1] * cosine, line[3] * sine + line[4] * cosine
        ranges[i] = (values[i] - first) / (1.0 if more == 0 else more)


@compiled_in_place
def fill_places(
    xyz: Floats, rings: Rows, lines: Floats, straight: Floats, offsets: Floats, nearest: float,
    ranges: Floats, around: Floats,
) -> None:  # fmt: skip
    """Compute ranges (n,) and azimuths (n,) in radians of points near the rays.

    Parameters
    ----------
    xyz, rings
        The points and their rings, (n,).
    lines
        Lines of the rings, (rings, 6).
    straight
        Each line's point at range 0, along its beam and sideways, and its increment, (3, rings).
    offsets
        Azimuths of the lines, (rings,), in radians.
    nearest
        Least horizontal distance that is used, in m.
    ranges, around
        Receive the results; they are not rounded.
    """
    for i in range(len(rings)):
        ring = rings[i]
        x, y, z, up = xyz[i, 0], xyz[i, 1], xyz[i, 2], lines[ring, 5]
        along, side, more = straight[0, ring], straight[1, ring], straight[2, ring]
        level, square = np.sqrt(x * x + y * y), more * more + up * up
        first = np.sqrt(max(level * level - side * side, 0.0))
        far = (first - along) * (more / square)
        ranges[i] = far + (z - lines[ring, 2]) * (up / square)
        angle = np.arctan2(y, x) - offsets[ring]
        if side != 0:
            angle -= np.arcsin(min(max(side / max(level, nearest), -1.0), 1.0))
        around[i] = angle


@compiled_in_place
def fill_turns(around: Floats, phase: float, step: float, turns: Floats) -> None:
    """Convert azimuths from radians to azimuth steps.

    Parameters
    ----------
    around
        Azimuths, (n,), in radians; they need not lie within one revolution.
    phase, step
        Azimuth of step 0, and angle of a step, in radians.
    turns
        Receives the azimuths as numbers of steps, (n,), from 0 to a whole revolution; they are not
        rounded.
    """
    for i in range(len(around)):
        turns[i] = ((around[i] - phase) % _FULL_TURN) / step


@compiled
def fitted_line(x: Floats, y: Floats) -> tuple[float, float]:
    """Fit the line ``y = start + slope * x`` by least squares, twice again without outliers.

    Parameters
    ----------
    x, y
        Coordinates of the points to which the line is fitted, (n,) each, in any units.

    Returns
    -------
    tuple of float
        Start (the value at x = 0, in the unit of y) and slope. A point is an outlier if its error
        is more than four times the median error. For fewer than three points, the line is
        horizontal, at the median of y.
    """
    errors, most = np.zeros(len(x)), np.inf
    start, slope = float(np.median(y)), 0.0
    for _ in range(3):
        count, x_sum, y_sum = 0, 0.0, 0.0
        for i in range(len(x)):
            if errors[i] <= most:
                count, x_sum, y_sum = count + 1, x_sum + x[i], y_sum + y[i]
        if count < 3:
            break
        x_mean, y_mean, square, product = x_sum / count, y_sum / count, 0.0, 0.0
        for i in range(len(x)):
            if errors[i] <= most:
                apart = x[i] - x_mean
                square, product = square + apart * apart, product + apart * (y[i] - y_mean)
        slope = product / square if square > 0 else 0.0
        start = y_mean - slope * x_mean
        for i in range(len(x)):
            errors[i] = abs(y[i] - start - slope * x[i])
        most = max(4 * float(np.median(errors)), 1e-9)
    return start, slope

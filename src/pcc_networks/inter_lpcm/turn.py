"""A turn of a spinning sensor as lines of points, in the authors' spherical coordinates.

A line has the points that one laser measured, in the order of the file. It ends where the azimuth
falls by more than a tenth of a turn, or after 16,384 points. Coordinates are the azimuth in steps
of 0.045 degrees, the elevation in degrees, and the horizontal distance in metres. They are computed
in single precision, as by the authors.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats

Ints = NDArray[np.int64]
STEPS_PER_TURN = 8000
"""Steps of the azimuth in a turn."""
_AZIMUTH_STEP = 360 / STEPS_PER_TURN
_DROP = STEPS_PER_TURN // 10
"""A line ends where the azimuth falls by more steps than this."""
MAX_LINE = 2**12
"""Largest number of points of a line. It bounds the time of a decoder, which takes a step for each
point of the longest line."""
_STEEPEST = 89.5
"""Elevations are clipped to plus and minus this value, in degrees, before points are placed."""


class Lines(NamedTuple):
    """The points of a turn in spherical coordinates, line after line.

    Parameters
    ----------
    azimuth
        (n,), whole steps of 0.045 degrees from 0 to 8,000.
    elevation
        (n,), degrees.
    radius
        (n,), horizontal distance from the sensor, m.
    starts
        (lines + 1,), index of the first point of each line, and n.
    """

    azimuth: Ints
    elevation: Floats
    radius: Floats
    starts: Ints

    @property
    def lengths(self) -> Ints:
        """Numbers of points of the lines, (lines,)."""
        return np.diff(self.starts)


def lines_of(points: Floats) -> Lines:
    """Divide a turn into its lines.

    Parameters
    ----------
    points
        Points (n, 3), n >= 1, in metres, in the order in which they were measured.

    Returns
    -------
    Lines
        The lines, with their points in the same order.
    """
    single = points.astype(np.float32)
    azimuth, elevation, radius = spherical(single)
    falls = np.flatnonzero(azimuth[:-1] > azimuth[1:] + _DROP) + 1
    ends = [0, *falls.tolist(), len(points)]
    cuts = [range(first, last, MAX_LINE) for first, last in itertools.pairwise(ends)]
    starts = np.array([*itertools.chain(*cuts), len(points)], np.int64)
    return Lines(
        azimuth.astype(np.int64), elevation.astype(np.float64), radius.astype(np.float64), starts
    )


def spherical(
    points: NDArray[np.floating],
) -> tuple[NDArray[np.floating], NDArray[np.floating], NDArray[np.floating]]:
    """Return azimuths in steps, elevations in degrees and horizontal distances of points (n, 3).

    The results (n,) have the precision of the points. A point on the sensor has the elevation 0.
    """
    x, y, z = points.T
    distance = np.sqrt(np.square(x) + np.square(y) + np.square(z))
    with np.errstate(divide="ignore", invalid="ignore"):
        elevation = np.rad2deg(np.arcsin(z / distance))
    degrees = np.rad2deg(np.arctan2(y, x))
    azimuth = np.round(np.where(degrees < 0, degrees + 360, degrees) / _AZIMUTH_STEP)
    radius = np.sqrt(np.square(x) + np.square(y))
    return azimuth, np.nan_to_num(elevation), radius


def cartesian(lines: Lines) -> Floats:
    """Return the points (n, 3), in metres, of lines."""
    azimuth = np.radians(lines.azimuth * _AZIMUTH_STEP)
    elevation = np.radians(np.clip(lines.elevation, -_STEEPEST, _STEEPEST))
    return np.column_stack(
        [
            lines.radius * np.cos(azimuth),
            lines.radius * np.sin(azimuth),
            lines.radius * np.tan(elevation),
        ]
    )

"""Lasers of an unknown sensor, fitted to the points that it measured.

The points of a laser lie on a cone, whose elevation and height `rings.fitted_cone` fits. The
azimuths of the lasers relative to each other follow from the times of the points, because the
sensor rotates at a constant rate during a message.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensor import Sensor
from puck.recordings.rings import fitted_cone

_FEWEST = 16
"""Smallest number of points to which a laser is fitted."""
_HEIGHT_PRIOR = 0.002
"""Weight of the prior that a laser's height is 0.

Points at a single distance do not determine the height.
"""
_USUAL_HZ, _LARGEST_STEP_RAD, _ROUNDS = 10.0, np.pi / 6, 3


class FittedLasers(NamedTuple):
    """A sensor whose lasers were fitted to n points, as `fitted_lasers` returns it.

    Parameters
    ----------
    sensor
        The fitted sensor.
    ranks
        Laser of each point, (n,), numbered from 0 by increasing elevation.
    is_used
        Whether each point belongs to a fitted laser, (n,).
    residuals_mm
        Distances of the used points from the cones of their lasers, in mm.
    """

    sensor: Sensor
    ranks: NDArray[np.intp]
    is_used: NDArray[np.bool_]
    residuals_mm: Floats

    def about(self) -> dict[str, object]:
        """Return the lasers' parameters, and how well they fit, as entries for a description."""
        sensor, off = self.sensor, np.abs(self.residuals_mm)
        table: dict[str, object] = {
            "laser_elevation_deg": list(sensor.laser_elevation_deg),
            "vertical_correction_mm": list(sensor.vertical_correction_mm or ()),
            "laser_fit_median_mm": round(float(np.median(off)), 2),
            "laser_fit_rms_mm": round(float(np.sqrt(np.mean(off**2))), 2),
        }
        if sensor.laser_azimuth_deg:
            table["laser_azimuth_deg"] = list(sensor.laser_azimuth_deg)
        if not self.is_used.all():
            table["points_left_out"] = int((~self.is_used).sum())
        return table


def fitted_lasers(
    xyz: Floats, ring: NDArray[np.integer], seconds: Floats, turn: NDArray[np.integer]
) -> FittedLasers:
    """Fit the lasers of an unknown sensor to the points that it measured.

    Parameters
    ----------
    xyz
        Points in sensor coordinates (x right, y forward, z up), (n, 3), in m.
    ring
        Number of each point's laser, (n,). The numbers may have any order. Lasers with fewer than
        16 points are left out.
    seconds
        Time of each point, (n,), in s. If all points of a turn have the same time, the azimuths of
        the lasers remain unknown.
    turn
        Number of the turn (revolution of the sensor) of each point, (n,).

    Raises
    ------
    InputError
        No laser has 16 points, or two lasers have the same elevation.
    """
    names, number, counts = np.unique(ring, return_inverse=True, return_counts=True)
    kept = np.flatnonzero(counts >= _FEWEST)
    if not len(kept):
        raise InputError(f"no laser has {_FEWEST} points, to which it could be fitted")
    level = np.hypot(xyz[:, 0], xyz[:, 1])
    rings = [number == k for k in kept]
    cones = np.array([fitted_cone(level[ring], xyz[ring, 2], _HEIGHT_PRIOR) for ring in rings])
    order = np.argsort(cones[:, 0], kind="stable")
    tangents, heights = cones[order].T
    ranks = np.zeros(len(names), np.intp)
    ranks[kept[order]] = np.arange(len(kept))
    ranks, is_used = ranks[number], np.isin(number, kept)
    off = (xyz[:, 2] - level * tangents[ranks] - heights[ranks]) / np.hypot(1, tangents[ranks])
    azimuth = np.arctan2(xyz[:, 0], xyz[:, 1])
    rate, turned = _rotation(
        azimuth[is_used], ranks[is_used], seconds[is_used], turn[is_used], lasers=len(kept)
    )
    elevations = _rounded(np.degrees(np.arctan(tangents)), 4)
    for place, (lower, upper) in enumerate(pairwise(elevations)):
        if lower == upper:
            first, second = names[kept[order]][place : place + 2]
            raise InputError(f"lasers {first:g} and {second:g} have the same elevation: {lower:g}")
    sensor = Sensor(
        name=f"fitted, {len(kept)} lasers",
        laser_elevation_deg=elevations,
        vertical_correction_mm=_rounded(1000 * heights, 2),
        laser_azimuth_deg=None if turned is None else _rounded(np.degrees(turned), 3),
        rotation_hz=rate,
        azimuth_step_deg=360 / max(counts.max() / max(len(np.unique(turn)), 1), 1),
        max_range_m=float(np.linalg.norm(xyz, axis=1).max()),
    )
    return FittedLasers(sensor, ranks, is_used, 1000 * off[is_used])


def _rounded(values: Floats, digits: int) -> tuple[float, ...]:
    return tuple(np.round(values, digits).tolist())


def _rotation(
    azimuth: Floats,
    laser: NDArray[np.intp],
    seconds: Floats,
    turn: NDArray[np.integer],
    *,
    lasers: int,
) -> tuple[float, Floats | None]:
    """Return the rotation rate in Hz, and the azimuths of the lasers in rad, or None if unknown."""
    order = np.lexsort((seconds, laser, turn))
    azimuth, laser, seconds = azimuth[order], laser[order], seconds[order]
    turn = np.unique(turn[order], return_inverse=True)[1]
    moved, steps = _half_open(np.diff(azimuth)), np.diff(seconds)
    is_step = (np.diff(laser) == 0) & (np.diff(turn) == 0) & (steps > 0)
    is_step &= np.abs(moved) < _LARGEST_STEP_RAD
    if is_step.sum() < _FEWEST:
        return _USUAL_HZ, None
    since = seconds - (np.bincount(turn, seconds) / np.bincount(turn))[turn]
    rate, turned = moved[is_step].sum() / steps[is_step].sum(), np.zeros(lasers)
    for _ in range(_ROUNDS):
        still = azimuth - rate * since
        around = np.exp(1j * still)
        phases = np.angle(np.bincount(turn, around.real) + 1j * np.bincount(turn, around.imag))
        left = _half_open(still - phases[turn])
        turned = np.array([np.median(left[laser == k]) for k in range(lasers)])
        left -= turned[laser]
        near = np.abs(left) <= 4 * np.median(np.abs(left)) + 1e-9
        rate += (since[near] * left[near]).sum() / (since[near] ** 2).sum()
    return abs(float(rate)) / (2 * np.pi), turned - turned.mean()


def _half_open(angles: Floats) -> Floats:
    return np.asarray(np.mod(angles + np.pi, 2 * np.pi) - np.pi)

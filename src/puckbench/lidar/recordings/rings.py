"""Returns recovered from frames of points, as data sets keep them: by rings, without the packets.

A ring holds the points of one laser. Its beam is a line that meets the sensor's axis at a height,
passes it at a distance, and is turned by a constant angle against the rotary encoder, whose steps
all lasers share. These four numbers are fitted to the ring; what is left of a point are the step of
the encoder and the range. Points that were moved by more than rounding do not fit; where firings
without a return tell how a car's motion was corrected, that is undone first.

References
----------
Velodyne HDL-64E S2 User's Manual 63-HDL64ES2, Appendix F (the calibration of a laser: vertical and
rotational correction, vertical and horizontal offset).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats
from puckbench.lidar.returns import USUAL_QUANTUM_M, Beams, Returns
from puckbench.lidar.turns import CENTIDEGREES, Layout, Turn

_NEAR_M = 0.2
"""Sensors report no return as a range of nothing; nearer points are none."""
_MOST_SIDEWAYS_M = 0.08
_MOST_TURNED_DEG = 14.0
_FEWEST = 16
"""Points of a ring from which its beam is fitted, at least."""
_ALIKE = 3
_MOST_MOVED_M = 4.0
"""In a turn: 80 m/s for a sensor that turns 20 times a second."""
_MOST_QUANTA = 0xFFFF

Steps = NDArray[np.int64]


@dataclass(frozen=True)
class Recovered:
    """Returns of a frame, and how well they are its points.

    Parameters
    ----------
    returns
        One turn.
    rows
        (n,) of the frame's points that are returns, in the order of ``returns.points()``.
    xyz
        (m, 3) points of the frame, as seen from the sensor where it was.
    """

    returns: Returns
    rows: NDArray[np.intp]
    xyz: Floats

    def about(self) -> dict[str, float]:
        """Points that are no returns, and how far the others are from their returns, in mm."""
        moved = np.linalg.norm(self.returns.points() - self.xyz[self.rows], axis=1)
        return {
            "points_left_out": len(self.xyz) - len(self.rows),
            "moved_rms_mm": 1000 * float(np.sqrt(np.mean(moved**2))),
            "moved_most_mm": 1000 * float(moved.max()),
        }


@dataclass(frozen=True)
class _Beam:
    """A laser's line: tangent of its elevation, height, distance from the axis; m."""

    tangent: float
    height: float
    sideways: float


def split_rings(azimuths: Floats) -> list[NDArray[np.intp]]:
    """Rows of each ring, in frames that have one ring after the other, each from azimuth 0 on.

    Parameters
    ----------
    azimuths
        (n,) of the points, in radians from 0, rising in a ring.
    """
    ends = np.flatnonzero(np.diff(azimuths) < -np.pi) + 1
    return list(np.split(np.arange(len(azimuths)), ends))


def recovered_returns(
    xyz: Floats, rings: Sequence[NDArray[np.intp]], step_deg: float, sensor: str
) -> Recovered:
    """The returns that a frame's points are, with the beams that fit them.

    Parameters
    ----------
    xyz
        (n, 3) in the sensor's frame (x right, y forward), turning counter-clockwise, m.
    rings
        Rows of each laser's points.
    step_deg
        Of the rotary encoder, whole hundredths of a degree: firings are at some of its steps.
    sensor
        Its name.

    Raises
    ------
    InputError
        A ring has too few points, or the points of one fit no laser.
    """
    level = np.hypot(xyz[:, 0], xyz[:, 1])
    azimuth = np.mod(np.arctan2(-xyz[:, 0], xyz[:, 1]), 2 * np.pi)
    kept = [rows[level[rows] > _NEAR_M] for rows in rings]
    if not kept or min(map(len, kept)) < _FEWEST:
        raise InputError(f"a ring of fewer than {_FEWEST} points, of which no laser can be found")
    step = np.radians(step_deg)
    beams, phases, places = [], [], []
    for rows in kept:
        tangent, height = _fitted_cone(level[rows], xyz[rows, 2])
        sideways, phase = _fitted_offset(level[rows], azimuth[rows], step)
        beams.append(_Beam(tangent, height, sideways))
        turned = azimuth[rows] - np.arcsin(np.clip(sideways / level[rows], -1, 1)) - phase
        phases.append(phase)
        places.append(np.rint(turned / step).astype(np.int64))
    around = round(2 * np.pi / step)
    shifts = _aligned([np.unique(place % around) for place in places], around, step_deg)
    columns = [(place - shift) % around for place, shift in zip(places, shifts, strict=True)]
    used = np.unique(np.concatenate(columns))
    at = [np.searchsorted(used, places) for places in columns]
    turned_deg = np.degrees(np.array(phases)) + step_deg * np.array(shifts)
    return _image(xyz, kept, at, beams, _Columns(used * step_deg, turned_deg, False), sensor)


def recovered_firings(xyz: Floats, sensor: str) -> Recovered:
    """The returns of a frame that has every firing of a sensor that turns clockwise.

    Where the car's motion was corrected, firings without a return, whose range is 0, stand at the
    sensor's place at their moment: so the motion is known, and is undone.

    Parameters
    ----------
    xyz
        (columns, lasers, 3) in the sensor's frame (x right, y forward) at the end of the turn, m.
    sensor
        Its name.

    Raises
    ------
    InputError
        A laser has too few returns.
    """
    columns, lasers = xyz.shape[:2]
    left = 1 - np.arange(columns) / max(columns - 1, 1)
    still = xyz - (left[:, None] * _first_place(xyz, left))[:, None]
    whole = np.hypot(still[..., 0], still[..., 1]) > _NEAR_M
    if whole.sum(axis=0).min() < _FEWEST:
        raise InputError(f"a laser with fewer than {_FEWEST} returns, which cannot be found")
    still, beams = _without_turning(still, whole, left)
    azimuth = np.degrees(np.arctan2(still[..., 0], still[..., 1]))
    apart = np.mod(azimuth - azimuth[:, [lasers // 2]] + 180, 360) - 180
    apart[~(whole & whole[:, [lasers // 2]])] = np.nan
    if np.isfinite(apart).sum(axis=0).min() < _FEWEST:
        raise InputError("a laser that hardly returns when the others do, which cannot be found")
    turned_deg = np.nanmedian(apart, axis=0)
    own = np.where(whole, azimuth - turned_deg, np.nan)
    seen = np.flatnonzero(whole.any(axis=1))
    around = np.radians(own[seen])
    middle = np.arctan2(np.nanmean(np.sin(around), axis=1), np.nanmean(np.cos(around), axis=1))
    off = np.nanmedian(np.mod(own[seen] - np.degrees(middle)[:, None] + 180, 360) - 180, axis=1)
    flat = still.reshape(-1, 3)
    rings = [seen[whole[seen, k]] * lasers + k for k in range(lasers)]
    at = [np.searchsorted(seen, rows // lasers) for rows in rings]
    azimuths = np.mod(np.degrees(middle) + off, 360)
    found = _image(flat, rings, at, beams, _Columns(azimuths, turned_deg, True), sensor)
    return Recovered(found.returns, found.rows, flat)


def _first_place(xyz: Floats, left: Floats) -> Floats:
    """Where the sensor was at the first firing (3,), by firings of no range; 0 without any.

    They are those that several lasers of a column give at the same point, on a straight way to 0.
    """
    same = [np.unique(np.round(column, 4), axis=0, return_counts=True) for column in xyz]
    places = np.array([points[np.argmax(counts)] for points, counts in same])
    clear = np.array([counts.max() >= _ALIKE for _, counts in same]) & (left > 0)
    clear &= np.linalg.norm(places, axis=1) <= _MOST_MOVED_M * left
    if clear.sum() < _FEWEST:
        return np.zeros(3)
    return np.asarray(np.median(places[clear] / left[clear, None], axis=0))


def _without_turning(
    xyz: Floats, whole: NDArray[np.bool_], left: Floats
) -> tuple[Floats, list[_Beam]]:
    """Points turned back by how the sensor pitched and rolled, and the lines of its lasers.

    Both by least squares of angles: heights of points are those of their laser's cone and of a
    small rotation that goes with the time that is left.
    """
    columns, lasers = np.nonzero(whole)
    points = xyz[columns, lasers]
    level = np.hypot(points[:, 0], points[:, 1])
    rows = np.zeros((len(points), 2 * xyz.shape[1] + 2))
    each = np.arange(len(points))
    rows[each, lasers] = 1
    rows[each, xyz.shape[1] + lasers] = 1 / level
    rows[:, -2:] = (left[columns] / level)[:, None] * points[:, :2]
    wanted = points[:, 2] / level
    near = np.ones(len(points), bool)
    found = np.zeros(rows.shape[1])
    for _ in range(3):
        found = np.linalg.lstsq(rows[near], wanted[near], rcond=None)[0]
        off = np.abs(rows @ found - wanted)
        near = off <= 4 * np.median(off)
    still = xyz.copy()
    still[..., 2] -= left[:, None] * (xyz[..., :2] @ found[-2:])
    count = xyz.shape[1]
    return still, [_Beam(float(found[k]), float(found[count + k]), 0.0) for k in range(count)]


def _fitted_cone(level: Floats, z: Floats) -> tuple[float, float]:
    """Tangent and height of z = level tangent + height; points that are off are left out twice."""
    near = np.ones(len(level), bool)
    found = np.zeros(2)
    for _ in range(3):
        weights = 1 / level[near]
        rows = np.column_stack([np.ones(near.sum()), weights])
        found = np.linalg.lstsq(rows, z[near] * weights, rcond=None)[0]
        off = np.abs(z - found[0] * level - found[1])
        near = off <= max(4 * float(np.median(off)), 1e-3)
    return float(found[0]), float(found[1])


def _fitted_offset(level: Floats, azimuth: Floats, step: float) -> tuple[float, float]:
    """Distance of a beam from the axis, and its angle beyond a step, by which azimuths are steps.

    The distance is that for which the angles beyond a step agree best (their mean on a circle is
    longest), tried in ever finer steps.
    """
    best, width = 0.0, _MOST_SIDEWAYS_M
    turns = azimuth / step
    while width > 1e-5:
        tried = best + np.linspace(-width, width, 33)
        shares = np.arcsin(np.clip(tried[:, None] / level, -1, 1)) / step
        lengths = np.abs(np.exp(2j * np.pi * (turns - shares)).mean(axis=1))
        best, width = float(tried[int(np.argmax(lengths))]), width / 8
    mean = np.exp(2j * np.pi * (turns - np.arcsin(np.clip(best / level, -1, 1)) / step)).mean()
    return best, float(np.angle(mean)) / (2 * np.pi) * step


def _aligned(places: Sequence[Steps], around: int, step_deg: float) -> list[int]:
    """Whole steps by which each ring is turned, so that lasers fire at the same steps."""
    most = round(_MOST_TURNED_DEG / step_deg)
    fired = np.zeros(around)
    shifts = [0] * len(places)
    for ring in np.argsort([-len(place) for place in places]).tolist():
        own = np.zeros(around)
        own[places[ring]] = 1
        if fired.any():
            both = np.fft.irfft(np.fft.rfft(own) * np.conj(np.fft.rfft(fired)), around)
            tried = np.arange(-most, most + 1)
            agreed = np.round(both[tried % around], 6)
            best = np.flatnonzero(agreed == agreed.max())
            shifts[ring] = int(tried[best[np.argmin(np.abs(tried[best]))]])
        fired[(places[ring] - shifts[ring]) % around] += 1
    return shifts


@dataclass(frozen=True)
class _Columns:
    """Azimuths of the columns, and of the lasers against them, in degrees; the direction."""

    azimuths_deg: Floats
    turned_deg: Floats
    clockwise: bool


def _image(
    xyz: Floats,
    rings: Sequence[NDArray[np.intp]],
    columns: Sequence[Steps],
    beams: Sequence[_Beam],
    known: _Columns,
    sensor: str,
) -> Recovered:
    """The turn of points in columns."""
    lasers = len(rings)
    ranges = np.zeros((1, len(known.azimuths_deg), lasers), np.uint16)
    source = np.zeros(ranges.shape[1:], np.intp)
    for laser, (rows, places, beam) in enumerate(zip(rings, columns, beams, strict=True)):
        points, cosine = xyz[rows], 1 / np.hypot(1.0, beam.tangent)
        level = np.sqrt(np.maximum(points[:, 0] ** 2 + points[:, 1] ** 2 - beam.sideways**2, 0.0))
        along = (level + (points[:, 2] - beam.height) * beam.tangent) * cosine
        quanta = np.rint(along / USUAL_QUANTUM_M)
        inside = (quanta > 0) & (quanta <= _MOST_QUANTA)
        ranges[0, places[inside], laser] = quanta[inside]
        source[places[inside], laser] = rows[inside]
    elevations = np.degrees(np.arctan([beam.tangent for beam in beams]))
    order = tuple(int(one) for one in np.argsort(elevations, kind="stable"))
    found = Beams(
        tuple(elevations.tolist()),
        tuple(1000 * beam.height for beam in beams),
        (0.0,) * lasers,
        clockwise=known.clockwise,
        azimuths_deg=tuple(known.turned_deg.tolist()),
        sideways_mm=tuple(1000 * beam.sideways for beam in beams),
    )
    azimuths = (np.rint(known.azimuths_deg * 100) % CENTIDEGREES).astype(np.uint16)
    if not ranges.any():
        raise InputError("no point is within 131 m, the most that returns can hold")
    returns = Returns(found, Layout(order), (Turn(ranges, azimuths),), USUAL_QUANTUM_M, sensor)
    return Recovered(returns, source[ranges[0] > 0], xyz)

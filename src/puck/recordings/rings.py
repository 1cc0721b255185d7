"""Recovery of a sensor's raw returns from published frames of points.

Each laser's points form a ring, to which four parameters are fitted: elevation, height, distance
from the sensor's axis, and angle relative to the rotary encoder (Velodyne HDL-64E S2 User's Manual
63-HDL64ES2, Appendix F). By these parameters, each point is converted to an encoder step and a
range.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.returns import USUAL_QUANTUM_M, Beams, Returns
from pointkit.lidar.turns import CENTIDEGREES, Layout, Turn

_NEAR_M = 0.2
"""Points nearer than this stand for firings without a return, which sensors report with range 0."""
_MOST_SIDEWAYS_M = 0.08
_MOST_TURNED_DEG = 14.0
_FEWEST = 16
"""Least number of points to which a laser's beam is fitted."""
_FEWEST_EQUAL = 3
_MOST_MOVED_M = 4.0
"""Limit of the sensor's motion in a revolution: 80 m/s at 20 revolutions per second."""
_MOST_QUANTA = 0xFFFF

Steps = NDArray[np.int64]


@dataclass(frozen=True)
class RecoveredReturns:
    """Returns that were recovered from a frame of points, as one revolution of the sensor.

    `xyz` (points, 3) are the frame's points in metres, in the coordinates of the moving sensor.
    `rows` (n,) are the indices in `xyz` of the points that became returns, in the order of
    ``returns.points()``.
    """

    returns: Returns
    rows: NDArray[np.intp]
    xyz: Floats

    def about(self) -> dict[str, float]:
        """Return the number of points left out, and how far the other points were moved.

        Returns
        -------
        dict
            ``points_left_out``, and the root mean square and maximum of displacements in
            millimetres, ``moved_rms_mm`` and ``moved_most_mm``.
        """
        moved = np.linalg.norm(self.returns.points() - self.xyz[self.rows], axis=1)
        return {
            "points_left_out": len(self.xyz) - len(self.rows),
            "moved_rms_mm": 1000 * float(np.sqrt(np.mean(moved**2))),
            "moved_most_mm": 1000 * float(moved.max()),
        }


_Beam = tuple[float, float, float]
"""A laser's tangent of elevation, height in metres, and distance from the axis in metres."""


def split_rings(azimuths: Floats) -> list[NDArray[np.intp]]:
    """Split a frame's points into one ring per laser, where the azimuths wrap around.

    Parameters
    ----------
    azimuths
        Azimuths (n,) of the points, in radians, laser by laser.

    Returns
    -------
    list of arrays
        Indices of each ring's points.
    """
    ends = np.flatnonzero(np.diff(azimuths) < -np.pi) + 1
    return list(np.split(np.arange(len(azimuths)), ends))


def recovered_returns(
    xyz: Floats, rings: Sequence[NDArray[np.intp]], step_deg: float, sensor: str
) -> RecoveredReturns:
    """Recover returns from the points of a frame, and fit each laser's parameters.

    Parameters
    ----------
    xyz
        Points (n, 3) in metres, in the coordinates (x right, y forward) of a sensor that rotates
        counter-clockwise.
    rings
        Indices of each laser's points, as `split_rings` returns them.
    step_deg
        Step of the rotary encoder in degrees, a multiple of 0.01.
    sensor
        Name of the sensor.

    Returns
    -------
    RecoveredReturns
        The returns, and the points they come from.
    """
    level = np.hypot(xyz[:, 0], xyz[:, 1])
    azimuth = np.mod(np.arctan2(-xyz[:, 0], xyz[:, 1]), 2 * np.pi)
    kept = [rows[level[rows] > _NEAR_M] for rows in rings]
    if not kept or min(map(len, kept)) < _FEWEST:
        raise InputError(f"a ring of fewer than {_FEWEST} points, too few to recover its laser")
    step = np.radians(step_deg)
    beams, phases, places = [], [], []
    for rows in kept:
        tangent, height = fitted_cone(level[rows], xyz[rows, 2])
        sideways, phase = _fitted_offset(level[rows], azimuth[rows], step)
        beams.append((tangent, height, sideways))
        turned = azimuth[rows] - np.arcsin(np.clip(sideways / level[rows], -1, 1)) - phase
        phases.append(phase)
        places.append(np.rint(turned / step).astype(np.int64))
    around = round(2 * np.pi / step)
    shifts = _aligned([np.unique(place % around) for place in places], around, step_deg)
    columns = [(place - shift) % around for place, shift in zip(places, shifts, strict=True)]
    used = np.unique(np.concatenate(columns))
    at = [np.searchsorted(used, places) for places in columns]
    turned_deg = np.degrees(np.array(phases)) + step_deg * np.array(shifts)
    return _image(xyz, kept, at, beams, (used * step_deg, turned_deg), False, sensor)


def recovered_firings(xyz: Floats, sensor: str) -> RecoveredReturns:
    """Recover returns from a frame that includes firings without a return, whose range is 0.

    The data set corrected the points for the motion of the car. Firings without a return reveal
    this correction, which is undone.

    Parameters
    ----------
    xyz
        Points (columns, lasers, 3) in metres, in the coordinates (x right, y forward) of a sensor
        that rotates clockwise, at the end of the revolution.
    sensor
        Name of the sensor.

    Returns
    -------
    RecoveredReturns
        The returns, and the points they come from.
    """
    columns, lasers = xyz.shape[:2]
    left = 1 - np.arange(columns) / max(columns - 1, 1)
    still = xyz - (left[:, None] * _first_place(xyz, left))[:, None]
    whole = np.hypot(still[..., 0], still[..., 1]) > _NEAR_M
    if whole.sum(axis=0).min() < _FEWEST:
        raise InputError(f"a laser with fewer than {_FEWEST} returns, too few to recover it")
    still, beams = _without_turning(still, whole, left)
    azimuth = np.degrees(np.arctan2(still[..., 0], still[..., 1]))
    apart = np.mod(azimuth - azimuth[:, [lasers // 2]] + 180, 360) - 180
    apart[~(whole & whole[:, [lasers // 2]])] = np.nan
    if np.isfinite(apart).sum(axis=0).min() < _FEWEST:
        raise InputError("a laser that rarely returns when the others do cannot be recovered")
    turned_deg = np.nanmedian(apart, axis=0)
    seen = np.flatnonzero(whole.any(axis=1))
    relative = np.where(whole, azimuth - turned_deg, np.nan)[seen]
    around = np.radians(relative)
    middle = np.arctan2(np.nanmean(np.sin(around), axis=1), np.nanmean(np.cos(around), axis=1))
    off = np.nanmedian(np.mod(relative - np.degrees(middle)[:, None] + 180, 360) - 180, axis=1)
    flat = still.reshape(-1, 3)
    rings = [seen[whole[seen, k]] * lasers + k for k in range(lasers)]
    at = [np.searchsorted(seen, rows // lasers) for rows in rings]
    azimuths = np.mod(np.degrees(middle) + off, 360)
    return _image(flat, rings, at, beams, (azimuths, turned_deg), True, sensor)


def _first_place(xyz: Floats, left: Floats) -> Floats:
    """Return the sensor's position (3,) at the first firing, or zeros if it cannot be estimated.

    Firings of range 0 reveal the position: several lasers of a column have equal points. The
    argument `left` is the remaining fraction of the revolution at each column.
    """
    same = [np.unique(np.round(column, 4), axis=0, return_counts=True) for column in xyz]
    places = np.array([points[np.argmax(counts)] for points, counts in same])
    clear = np.array([counts.max() >= _FEWEST_EQUAL for _, counts in same]) & (left > 0)
    clear &= np.linalg.norm(places, axis=1) <= _MOST_MOVED_M * left
    if clear.sum() < _FEWEST:
        return np.zeros(3)
    return np.asarray(np.median(places[clear] / left[clear, None], axis=0))


def _without_turning(
    xyz: Floats, whole: NDArray[np.bool_], left: Floats
) -> tuple[Floats, list[_Beam]]:
    """Undo the sensor's pitch and roll in a revolution, and return the points and the lasers.

    Pitch, roll and the lasers' parameters are fitted to elevations by least squares. The argument
    `whole` is the mask of returns, and `left` is as in `_first_place`.
    """
    columns, lasers = np.nonzero(whole)
    points = xyz[columns, lasers]
    level = np.hypot(points[:, 0], points[:, 1])
    rows = np.zeros((len(points), 2 * xyz.shape[1] + 2))
    each = np.arange(len(points))
    rows[each, lasers] = 1
    rows[each, xyz.shape[1] + lasers] = 1 / level
    rows[:, -2:] = (left[columns] / level)[:, None] * points[:, :2]
    tangents = points[:, 2] / level
    near = np.ones(len(points), bool)
    fit = np.zeros(rows.shape[1])
    for _ in range(3):
        fit = np.linalg.lstsq(rows[near], tangents[near], rcond=None)[0]
        off = np.abs(rows @ fit - tangents)
        near = off <= 4 * np.median(off)
    still = xyz.copy()
    still[..., 2] -= left[:, None] * (xyz[..., :2] @ fit[-2:])
    count = xyz.shape[1]
    return still, [(float(fit[k]), float(fit[count + k]), 0.0) for k in range(count)]


def fitted_cone(level: Floats, z: Floats, prior: float = 0.0) -> tuple[float, float]:
    """Fit ``z = level * tangent + height`` without outliers.

    Parameters
    ----------
    level, z
        Distance from the axis and height of each point of a laser, in metres.
    prior
        Weight of a height of 0, relative to the weight of a point at 1 m.

    Returns
    -------
    tangent, height
        Tangent of the laser's elevation, and the beam's height at the axis in metres.
    """
    near = np.ones(len(level), bool)
    fit = np.zeros(2)
    for _ in range(3):
        weights = 1 / level[near]
        rows = np.column_stack([np.ones(near.sum()), weights])
        values = z[near] * weights
        if prior:
            rows = np.vstack([rows, [0, prior * np.sqrt(len(weights))]])
            values = np.append(values, 0)
        fit = np.linalg.lstsq(rows, values, rcond=None)[0]
        off = np.abs(z - fit[0] * level - fit[1])
        near = off <= max(4 * float(np.median(off)), 1e-3)
    return float(fit[0]), float(fit[1])


def _fitted_offset(level: Floats, azimuth: Floats, step: float) -> tuple[float, float]:
    """Return a laser's distance from the axis in metres, and its azimuth modulo the encoder's step.

    The azimuth is in radians. The distance maximises the length of the circular mean of the points'
    azimuths modulo the step.
    """
    best, width = 0.0, _MOST_SIDEWAYS_M
    turns = azimuth / step
    while width > 1e-5:
        candidates = best + np.linspace(-width, width, 33)
        shares = np.arcsin(np.clip(candidates[:, None] / level, -1, 1)) / step
        lengths = np.abs(np.exp(2j * np.pi * (turns - shares)).mean(axis=1))
        best, width = float(candidates[int(np.argmax(lengths))]), width / 8
    mean = np.exp(2j * np.pi * (turns - np.arcsin(np.clip(best / level, -1, 1)) / step)).mean()
    return best, float(np.angle(mean)) / (2 * np.pi) * step


def _aligned(places: Sequence[Steps], around: int, step_deg: float) -> list[int]:
    """Return the shift of each ring's azimuths, in encoder steps, that aligns the lasers."""
    most = round(_MOST_TURNED_DEG / step_deg)
    fired = np.zeros(around)
    shifts = [0] * len(places)
    for ring in np.argsort([-len(place) for place in places]).tolist():
        steps = np.zeros(around)
        steps[places[ring]] = 1
        if fired.any():
            both = np.fft.irfft(np.fft.rfft(steps) * np.conj(np.fft.rfft(fired)), around)
            candidates = np.arange(-most, most + 1)
            agreement = np.round(both[candidates % around], 6)
            best = candidates[np.flatnonzero(agreement == agreement.max())]
            shifts[ring] = int(best[np.argmin(np.abs(best))])
        fired[(places[ring] - shifts[ring]) % around] += 1
    return shifts


def _image(
    xyz: Floats,
    rings: Sequence[NDArray[np.intp]],
    columns: Sequence[Steps],
    beams: Sequence[_Beam],
    degrees: tuple[Floats, Floats],
    clockwise: bool,
    sensor: str,
) -> RecoveredReturns:
    """Return the returns; `degrees` are azimuths of columns, and of lasers relative to columns."""
    lasers, (columns_deg, lasers_deg) = len(rings), degrees
    ranges = np.zeros((1, len(columns_deg), lasers), np.uint16)
    source = np.zeros(ranges.shape[1:], np.intp)
    for laser, (rows, places, beam) in enumerate(zip(rings, columns, beams, strict=True)):
        tangent, height, sideways = beam
        points, cosine = xyz[rows], 1 / np.hypot(1.0, tangent)
        level = np.sqrt(np.maximum(points[:, 0] ** 2 + points[:, 1] ** 2 - sideways**2, 0.0))
        along = (level + (points[:, 2] - height) * tangent) * cosine
        quanta = np.rint(along / USUAL_QUANTUM_M)
        inside = (quanta > 0) & (quanta <= _MOST_QUANTA)
        ranges[0, places[inside], laser] = quanta[inside]
        source[places[inside], laser] = rows[inside]
    tangents, heights, offsets = np.transpose(beams)
    elevations = np.degrees(np.arctan(tangents))
    order = tuple(int(laser) for laser in np.argsort(elevations, kind="stable"))
    fitted = Beams(
        tuple(elevations.tolist()),
        tuple((1000 * heights).tolist()),
        (0.0,) * lasers,
        clockwise=clockwise,
        azimuths_deg=tuple(lasers_deg.tolist()),
        sideways_mm=tuple((1000 * offsets).tolist()),
    )
    azimuths = (np.rint(columns_deg * 100) % CENTIDEGREES).astype(np.uint16)
    if not ranges.any():
        raise InputError("no point is within 131 m, the maximum range of returns")
    returns = Returns(fitted, Layout(order), (Turn(ranges, azimuths),), USUAL_QUANTUM_M, sensor)
    return RecoveredReturns(returns, source[ranges[0] > 0], xyz)

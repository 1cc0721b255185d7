"""Smoothing of decoded ranges, which moves returns along their rays towards fitted planes.

Ranges of different lasers differ by biases, which are estimated from planes that several lasers
hit, and subtracted. A return moves out of its quantisation interval by at most three standard
deviations of the noise, or a tenth of the step. Returns that scatter around a plane by more than
the noise, as those of leaves do, are moved less. The last bits of results depend on how a machine
rounds sines and square roots.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pointkit.compiling import compiled_in_place
from pointkit.geometry.cholesky import factorise, solve, substitute
from pointkit.geometry.cloud import Floats
from pointkit.lidar.returns import Returns
from pointkit.lidar.turns import Turn
from puck.planes import LabelledPlanes, Labels, Places, RangeRows, fitted_planes, range_error

_TOLERANCE = 0.5
"""Tolerance of `fitted_planes` after biases are subtracted."""
_FIRST_TOLERANCE = 3.0
"""Minimum tolerance before biases are subtracted; biases above the noise increase it."""
_PASSES = 3
_WIDEN = 3.0
"""Number of standard deviations of the noise by which a return may leave its interval."""
_WIDEN_STEPS = 0.1
"""Fraction of the step by which any return may leave its interval; large steps hide the noise."""
_MOST_NOISE_M = 0.05
"""Upper limit of the estimated noise in metres. Larger estimates come from leaves."""
_SCATTER = 5.0
"""A return is not moved if it is farther from its plane than this number of standard deviations."""
_SUPPORT = 5
"""Planes with fewer returns are ignored."""
_BIAS_M = 0.02
"""Prior standard deviation of a laser's bias."""
_BIAS_SUPPORT = 50
"""Biases are estimated from planes with at least this number of returns."""
_CORRELATED = 100.0
"""Number of neighbouring returns that count as one, because their errors are correlated."""
_HUGE = 1e30

_loop = partial(compiled_in_place, error_model="numpy")


def smoothed_points(returns: Returns, steps_m: Sequence[float]) -> Floats:
    """Return the points of decoded returns, moved along their rays to smooth surfaces.

    Planes are fitted to the first returns of each turn, and each of these returns moves towards its
    plane. A return leaves its quantisation interval by at most three standard deviations of the
    range noise or a tenth of the step.

    Parameters
    ----------
    returns
        Decoded returns.
    steps_m
        Quantisation step of each turn's ranges in metres, as `puck.range_steps` returns it.

    Returns
    -------
    array (n, 3)
        Points in the sensor's coordinates, in metres, in the order of ``returns.points()``.
    """
    distances = [
        smoothed_distances(returns, turn, step)
        for turn, step in zip(returns.turns, steps_m, strict=True)
    ]
    return returns.points(distances)


def smoothed_distances(returns: Returns, turn: Turn, step_m: float) -> Floats:
    """Return the smoothed distances of a turn's returns.

    Second returns, which come from edges, leaves and glass, are not changed.

    Parameters
    ----------
    returns
        The returns that the turn belongs to, with the sensor's beams.
    turn
        The decoded turn.
    step_m
        Quantisation step of the turn's ranges, in metres.

    Returns
    -------
    array (returns per beam, columns, lasers)
        Distances in metres; 0 where there is no return.
    """
    order = np.asarray(returns.layout.order)
    elevations = np.radians(returns.beams.elevations_deg)[order]
    azimuths = np.ascontiguousarray(returns.azimuths(turn)[:, order].T)
    side = np.sin(azimuths) if returns.beams.clockwise else -np.sin(azimuths)
    level = np.cos(elevations)[:, None]
    up = np.broadcast_to(np.sin(elevations)[:, None], azimuths.shape)
    directions = np.stack([level * side, level * np.cos(azimuths), up], axis=2)
    origins = _origins(returns, turn, azimuths, order)
    distances = returns.distances(turn)
    coded = np.ascontiguousarray(distances[0][:, order].T)
    steps = np.mod(np.diff(azimuths[0]), 2 * np.pi)
    column = float(np.median(steps)) if len(steps) else 0.0
    closes = float(np.mod(azimuths[0, 0] - azimuths[0, -1], 2 * np.pi)) < 3 * column
    distances[0][:, order] = smoothed_ranges(coded, directions, origins, column, closes, step_m).T
    return distances


def _origins(returns: Returns, turn: Turn, azimuths: Floats, order: NDArray[np.intp]) -> Floats:
    beams = returns.beams
    origins = np.zeros((*azimuths.shape, 3))
    origins[..., 2] = (np.asarray(beams.heights_mm)[order] / 1000)[:, None]
    if beams.sideways_mm:
        sideways = (np.asarray(beams.sideways_mm)[order] / 1000)[:, None]
        origins[..., 0] = sideways * np.cos(azimuths)
        origins[..., 1] = -sideways * np.sin(azimuths)
    if beams.radial_mm:
        radial = (np.asarray(beams.radial_mm)[order] / 1000)[:, None]
        turned = returns.column_azimuths(turn)[:, order].T
        origins[..., 0] += radial * np.sin(turned)
        origins[..., 1] += radial * np.cos(turned)
    if not beams.clockwise:
        origins[..., 0] = -origins[..., 0]
    return origins


def smoothed_ranges(
    coded: Floats,
    directions: Floats,
    origins: Floats,
    column: float,
    closes: bool,
    step_m: float,
) -> Floats:
    """Return the smoothed ranges of a decoded range image.

    Parameters
    ----------
    coded
        Decoded ranges (lasers, columns) in metres; 0 means no return.
    directions, origins
        Directions and origins of the beams, (lasers, columns, 3).
    column, closes
        Angle between adjacent columns, and whether they make a full turn, as in
        `planes.fitted_planes`.
    step_m
        Quantisation step of the ranges, in metres.

    Returns
    -------
    array (lasers, columns)
        Ranges in metres; 0 where there is no return.
    """
    noise = _noise(coded)
    std = max(noise, step_m / np.sqrt(12))
    biases = np.zeros(len(coded))
    image = _image(coded, directions, origins, biases)
    if not std > 0 or not np.abs(image.rows).max(initial=0.0) < _HUGE:
        return coded
    unknown = max(_FIRST_TOLERANCE, 4 * (_BIAS_M / std) ** 2)
    planes = fitted_planes(image, column, std, unknown, closes)
    for _ in range(_PASSES - 1):
        biases += _biases(image, planes, std)
        image = _image(coded, directions, origins, biases)
        planes = fitted_planes(image, column, std, _TOLERANCE, closes)
    limit = step_m / 2 + max(_WIDEN * noise, _WIDEN_STEPS * step_m)
    smoothed = np.where(image.ranges > 0, image.ranges, coded)
    spread = np.zeros((len(planes.vectors), 2))
    _estimate(image.ranges, directions, origins, *planes, std, limit, spread, smoothed)
    return np.where(np.isfinite(smoothed) & (smoothed > 0), smoothed, coded)


def _noise(ranges: Floats) -> float:
    """Estimate the standard deviation of the range noise from second differences within rows."""
    parts = ranges[:, :-2], ranges[:, 1:-1], ranges[:, 2:]
    is_complete = (parts[0] > 0) & (parts[1] > 0) & (parts[2] > 0)
    if not is_complete.any():
        return 0.0
    differences = np.abs(parts[0] - 2 * parts[1] + parts[2])[is_complete]
    return min(float(np.median(differences) / 0.6745 / np.sqrt(6)), _MOST_NOISE_M)


def _image(coded: Floats, directions: Floats, origins: Floats, biases: Floats) -> RangeRows:
    ranges = np.where(coded > 0, coded - biases[:, None], 0.0)
    rows = directions * ranges[..., None]
    rows += origins
    rows *= ranges[..., None]
    return RangeRows(ranges, rows)


def _biases(image: RangeRows, planes: LabelledPlanes, std: float) -> Floats:
    """Return an estimate of each laser's bias, (lasers,), in metres, with mean zero.

    A bias that all lasers share cannot be told from a larger room.
    """
    labels, vectors = planes
    lasers, most = len(labels), 3 * std
    counts = np.zeros(len(vectors), np.int64)
    _count(image, labels, vectors, most, counts)
    large = np.flatnonzero(counts >= _BIAS_SUPPORT)
    places = np.full(len(vectors), -1, np.int64)
    places[large] = np.arange(len(large))
    products, mixed = np.zeros((len(large), 3, 4)), np.zeros((len(large), lasers, 3))
    numbers, targets = np.zeros(lasers), np.zeros(lasers)
    _sum_by_laser(image, labels, vectors, most, places, products, mixed, numbers, targets)
    matrix, right = np.diag(numbers), targets
    _eliminate(products, mixed, matrix, right)
    weight = 1 / (std * std * _CORRELATED)
    solution = weight * right
    solve(weight * matrix + np.eye(lasers) / _BIAS_M**2, solution)
    biases: Floats = np.asarray(solution.mean() - solution)
    return biases if np.isfinite(biases).all() else np.zeros(lasers)


@_loop
def _eliminate(products: Floats, mixed: Floats, matrix: Floats, right: Floats) -> None:
    for plane in range(len(products)):
        normal, target, slopes = products[plane, :, :3], products[plane, :, 3], mixed[plane]
        ridge = 1e-9 * (normal[0, 0] + normal[1, 1] + normal[2, 2])
        for i in range(3):
            normal[i, i] += ridge
        factorise(normal, -np.inf)
        substitute(normal, target)
        for laser in range(len(right)):
            substitute(normal, slopes[laser])
            for i in range(3):
                right[laser] -= slopes[laser, i] * target[i]
                for other in range(laser + 1):
                    matrix[laser, other] -= slopes[laser, i] * slopes[other, i]


@_loop
def _count(image: RangeRows, labels: Labels, planes: Floats, most: float, counts: Places) -> None:
    ranges, rows = image
    for laser in range(labels.shape[0]):
        for column in range(labels.shape[1]):
            plane = labels[laser, column]
            if plane >= 0:
                error = range_error(rows[laser, column], ranges[laser, column], planes[plane])
                if abs(error) < most:
                    counts[plane] += 1


@_loop
def _sum_by_laser(
    image: RangeRows, labels: Labels, planes: Floats, most: float, places: Places,
    products: Floats, mixed: Floats, numbers: Floats, targets: Floats,
) -> None:  # fmt: skip
    ranges, rows = image
    for laser in range(labels.shape[0]):
        for column in range(labels.shape[1]):
            plane = labels[laser, column]
            if plane < 0 or places[plane] < 0:
                continue
            row, target = rows[laser, column], ranges[laser, column]
            error = range_error(row, target, planes[plane])
            if not abs(error) < most:
                continue
            place = places[plane]
            for i in range(3):
                for j in range(3):
                    products[place, i, j] += row[i] * row[j]
                products[place, i, 3] += row[i] * target
                mixed[place, laser, i] += row[i]
            numbers[laser] += 1
            targets[laser] += target


@_loop
def _estimate(
    ranges: Floats, directions: Floats, origins: Floats, labels: Labels, planes: Floats, std: float,
    limit: float, spread: Floats, smoothed: Floats,
) -> None:  # fmt: skip
    """Move each range in `smoothed` towards its plane by at most `limit`.

    Each plane's number of returns and sum of squared errors are written to `spread` (planes, 2).
    """
    for moves in (False, True):
        for laser in range(labels.shape[0]):
            for column in range(labels.shape[1]):
                plane = labels[laser, column]
                if plane < 0:
                    continue
                m, d, o = planes[plane], directions[laser, column], origins[laser, column]
                down = m[0] * d[0] + m[1] * d[1] + m[2] * d[2]
                start = m[0] * o[0] + m[1] * o[1] + m[2] * o[2]
                error = (1 - start) / down - ranges[laser, column]
                if not abs(error) < _SCATTER * std:
                    continue
                if not moves:
                    spread[plane, 0] += 1
                    spread[plane, 1] += error * error
                elif spread[plane, 0] >= _SUPPORT:
                    expected = std * std * (spread[plane, 0] - 3)
                    weight = min(1.0, expected / max(spread[plane, 1], expected * 1e-9))
                    smoothed[laser, column] += min(max(weight * error, -limit), limit)

"""Ranges of a turn as they most likely were, before noise and quantisation.

Where a plane fits returns side by side in the image, a return takes the plane's range along its own
ray: the error falls with the root of the number of returns. Biases of the lasers are estimated from
the planes that several of them see, and taken away. The standard deviation of a range is estimated
from the turn itself, or follows from the step of quantisation. No return leaves the interval that
the stream gives for its range by more than three standard deviations. Where returns scatter about
their plane by more than noise explains (leaves), they are moved less, in proportion. Of a return
that no plane supports, the bias of its laser alone is removed.

Results do not depend on a machine's libraries of linear algebra; where sines or square roots are
rounded in another way, the last bits may differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from puckbench.core.compiling import compiled_in_place, inlined
from puckbench.geometry.cloud import Floats
from puckbench.lidar.returns import Beams, Returns
from puckbench.lidar.turns import Turn
from puckbench.puck.planes import (
    Labels,
    Places,
    Planes,
    RangeImage,
    fitted_planes,
    range_error,
)

_TOLERANCE = 0.5
"""Of `fitted_planes`, once biases are known."""
_FIRST_TOLERANCE = 3.0
"""The same before, at least; more where biases are assumed to be larger than the noise."""
_PASSES = 3
_WIDEN = 3.0
"""Standard deviations that a return may leave its interval by."""
_WIDEN_STEPS = 0.1
"""The same in steps, which hide the noise where they are larger than it."""
_MOST_NOISE_M = 0.05
"""Noise of a sensor, at most: more is taken for leaves."""
_SCATTER = 5.0
"""Standard deviations that a return of a plane may be off it by."""
_SUPPORT = 5
"""Returns of a plane that returns are moved to, at least."""
_BIAS_M = 0.02
"""Assumed standard deviation of a laser's bias."""
_BIAS_SUPPORT = 50
"""Returns of a plane that biases are estimated from, at least."""
_CORRELATED = 100.0
"""Neighbouring returns that count as one, since most of their errors is common."""
_HUGE = 1e30

_loop = partial(compiled_in_place, error_model="numpy")


def smoothed_points(returns: Returns, steps_m: Sequence[float]) -> Floats:
    """Return the points (n, 3) of returns in m, each moved along its ray to the likely surface.

    Parameters
    ----------
    returns
        Decoded returns.
    steps_m
        Step with which the ranges of each turn were quantised, m (see `returns.range_steps`).
    """
    distances = [
        smoothed_distances(returns, turn, step)
        for turn, step in zip(returns.turns, steps_m, strict=True)
    ]
    return returns.points(distances)


def smoothed_distances(returns: Returns, turn: Turn, step_m: float) -> Floats:
    """Distances of a turn's returns, smoothed: (kinds, columns, lasers), m, 0 for no return.

    Second returns stay as they are: they come from edges, leaves and glass.

    Parameters
    ----------
    returns
        Of which the turn is one.
    step_m
        Step that the ranges were quantised with, m.
    """
    order = np.asarray(returns.layout.order)
    elevations = np.radians(returns.beams.elevations_deg)[order]
    azimuths = np.ascontiguousarray(returns.azimuths(turn)[:, order].T)
    side = np.sin(azimuths) if returns.beams.clockwise else -np.sin(azimuths)
    level = np.cos(elevations)[:, None]
    up = np.broadcast_to(np.sin(elevations)[:, None], azimuths.shape)
    directions = np.stack([level * side, level * np.cos(azimuths), up], axis=2)
    origins = _origins(returns.beams, azimuths, order)
    distances: Floats = turn.ranges.astype(np.float64) * returns.quantum_m
    coded = np.ascontiguousarray(distances[0][:, order].T)
    steps = np.mod(np.diff(azimuths[0]), 2 * np.pi)
    column = float(np.median(steps)) if len(steps) else 0.0
    closes = float(np.mod(azimuths[0, 0] - azimuths[0, -1], 2 * np.pi)) < 3 * column
    distances[0][:, order] = smoothed_ranges(coded, directions, origins, column, closes, step_m).T
    return distances


def _origins(beams: Beams, azimuths: Floats, order: NDArray[np.intp]) -> Floats:
    """Where beams start, (lasers, columns, 3), m: at the laser's height, and beside the axis."""
    found = np.zeros((*azimuths.shape, 3))
    found[..., 2] = (np.asarray(beams.heights_mm)[order] / 1000)[:, None]
    if beams.sideways_mm:
        sideways = (np.asarray(beams.sideways_mm)[order] / 1000)[:, None]
        right = sideways * np.cos(azimuths)
        found[..., 0] = right if beams.clockwise else -right
        found[..., 1] = -sideways * np.sin(azimuths)
    return found


def smoothed_ranges(
    coded: Floats,
    directions: Floats,
    origins: Floats,
    column: float,
    closes: bool,
    step_m: float,
) -> Floats:
    """Smooth the ranges of an image.

    Parameters
    ----------
    coded
        (lasers, columns), from the lowest laser to the highest, m, 0 for no return.
    directions
        (lasers, columns, 3), of length 1.
    origins
        (lasers, columns, 3), where beams start, m.
    column
        Angle between columns, rad.
    closes
        Whether the last column is beside the first.
    step_m
        Step that the ranges were quantised with, m.

    Returns
    -------
    Floats
        (lasers, columns), m.
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
    found = np.where(image.ranges > 0, image.ranges, coded)
    spread = np.zeros((len(planes.vectors), 2))
    _estimate(image.ranges, directions, origins, *planes, std, limit, spread, found)
    return np.where(np.isfinite(found) & (found > 0), found, coded)


def _noise(ranges: Floats) -> float:
    """Standard deviation of the ranges' error by that of their second differences in a row."""
    parts = ranges[:, :-2], ranges[:, 1:-1], ranges[:, 2:]
    whole = (parts[0] > 0) & (parts[1] > 0) & (parts[2] > 0)
    if not whole.any():
        return 0.0
    bend = np.abs(parts[0] - 2 * parts[1] + parts[2])[whole]
    return min(float(np.median(bend) / 0.6745 / np.sqrt(6)), _MOST_NOISE_M)


def _image(coded: Floats, directions: Floats, origins: Floats, biases: Floats) -> RangeImage:
    ranges = np.where(coded > 0, coded - biases[:, None], 0.0)
    rows = directions * ranges[..., None]
    rows += origins
    rows *= ranges[..., None]
    return RangeImage(ranges, rows)


def _biases(image: RangeImage, planes: Planes, std: float) -> Floats:
    """Biases of the lasers, (lasers,), m, zero on average.

    Planes and biases together minimise the squared errors; the planes are eliminated. A bias that
    all lasers share cannot be told from larger rooms.
    """
    labels, vectors = planes
    lasers, most = len(labels), 3 * std
    counts = np.zeros(len(vectors), np.int64)
    _count(image.ranges, image.rows, labels, vectors, most, counts)
    large = np.flatnonzero(counts >= _BIAS_SUPPORT)
    places = np.full(len(vectors), -1, np.int64)
    places[large] = np.arange(len(large))
    products, mixed = np.zeros((len(large), 3, 4)), np.zeros((len(large), lasers, 3))
    numbers, targets = np.zeros(lasers), np.zeros(lasers)
    _sum_by_laser(
        image.ranges, image.rows, labels, vectors, most, places, products, mixed, numbers, targets
    )
    matrix, right = np.diag(numbers), targets
    _eliminate(products, mixed, matrix, right)
    weight = 1 / (std * std * _CORRELATED)
    found = weight * right
    _solve(weight * matrix + np.eye(lasers) / _BIAS_M**2, found)
    biases: Floats = np.asarray(found.mean() - found)
    return biases if np.isfinite(biases).all() else np.zeros(lasers)


@inlined
def _factorise(matrix: Floats) -> None:
    """Cholesky's factor of a positive definite matrix, in place, in its lower half.

    By loops of our own, here as below: what a library of linear algebra returns depends in its last
    digits on the processor, and bits of the points would.
    """
    for i in range(len(matrix)):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(rest) if i == j else rest / matrix[j, j]


@inlined
def _substitute(factor: Floats, right: Floats) -> None:
    """Solve factor . x = right for x, in place; the factor is a lower triangle."""
    for i in range(len(right)):
        for k in range(i):
            right[i] -= factor[i, k] * right[k]
        right[i] /= factor[i, i]


@_loop
def _solve(matrix: Floats, right: Floats) -> None:
    """Solve matrix . x = right for x, in place; the matrix is positive definite."""
    _factorise(matrix)
    _substitute(matrix, right)
    for i in range(len(right) - 1, -1, -1):
        for k in range(i + 1, len(right)):
            right[i] -= matrix[k, i] * right[k]
        right[i] /= matrix[i, i]


@_loop
def _eliminate(products: Floats, mixed: Floats, matrix: Floats, right: Floats) -> None:
    """Take the planes out of the normal equations of planes and biases.

    matrix, right: (lasers, lasers) and (lasers,), the equations of the biases, which are changed.
    products, mixed: as of `_sum_by_laser`; they are overwritten.
    """
    for plane in range(len(products)):
        normal, target, each = products[plane, :, :3], products[plane, :, 3], mixed[plane]
        ridge = 1e-9 * (normal[0, 0] + normal[1, 1] + normal[2, 2])
        for i in range(3):
            normal[i, i] += ridge
        _factorise(normal)
        _substitute(normal, target)
        for laser in range(len(right)):
            _substitute(normal, each[laser])
            for i in range(3):
                right[laser] -= each[laser, i] * target[i]
                for other in range(laser + 1):
                    matrix[laser, other] -= each[laser, i] * each[other, i]


@_loop
def _count(
    ranges: Floats,
    rows: Floats,
    labels: Labels,
    planes: Floats,
    most: float,
    counts: Places,
) -> None:
    """How many returns each plane has that are off it by less than `most`."""
    for laser in range(labels.shape[0]):
        for column in range(labels.shape[1]):
            plane = labels[laser, column]
            if plane >= 0:
                error = range_error(rows[laser, column], ranges[laser, column], planes[plane])
                if abs(error) < most:
                    counts[plane] += 1


@_loop
def _sum_by_laser(
    ranges: Floats,
    rows: Floats,
    labels: Labels,
    planes: Floats,
    most: float,
    places: Places,
    products: Floats,
    mixed: Floats,
    numbers: Floats,
    targets: Floats,
) -> None:
    """The parts of the normal equations of planes and biases."""
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
    ranges: Floats,
    directions: Floats,
    origins: Floats,
    labels: Labels,
    planes: Floats,
    std: float,
    limit: float,
    spread: Floats,
    found: Floats,
) -> None:
    """Move returns to their plane along their ray.

    spread: (planes, 2), zeros, for the number and the squared errors of each plane's returns.
    found: the ranges, which are changed.
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
                    found[laser, column] += min(max(weight * error, -limit), limit)

"""Compiled loops of the likelihood: sums over returns, and elimination of random biases.

A return's row of the design matrix has five non-zero entries: three coefficients (b0, b1, b2) of
its plane, 1 for the laser's bias, and 1 for the laser's bias in the scan.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pointkit.compiling import compiled
from pointkit.geometry.cholesky import factorise, substitute
from pointkit.geometry.cloud import Floats
from pointkit.geometry.moments import add_point
from virtual_lidar.calibration.observations import Codes

# Columns of the sums of a group: w = 1 / variance, b the basis, z the error.
WIDTH = 16
_W, _WB, _WBB, _WZ, _WZB = 0, 1, 4, 10, 11
SQUARES, LOGARITHMS = 14, 15


class Columns(NamedTuple):
    """Cell and surface of each of g groups of returns, and the matrix columns of two of its biases.

    Parameters
    ----------
    cell, surface
        Number of each group's cell and surface, (g,).
    laser, scan
        Matrix columns of the laser's bias, and of the laser's bias in its scan, (g,).
    """

    cell: Codes
    surface: Codes
    laser: Codes
    scan: Codes


@compiled
def group_sums(
    groups: Codes,
    values: tuple[Floats, Floats, Floats],
    sigma: tuple[float, float, float],
    least: tuple[float, float],
    sums: Floats,
) -> None:
    """Sum the terms of the normal equations over each group of returns.

    Parameters
    ----------
    groups
        First row of each of g groups, followed by the number of rows n, (g + 1,).
    values
        Errors z (n,), basis b (n, 3) and features (n, 3) of the returns.
    sigma
        Factors of the three features; the sum of the products is a return's standard deviation, m.
    least
        Least standard deviation, m, and a constant that is added to the variance, m^2.
    sums
        Array (g, 16) to which the result is written: sums of w, w b (3), w b b (6), w z, w z b (3),
        w z z and the logarithm of the variance, where w = 1 / variance.
    """
    errors, basis, features = values
    for group in range(len(groups) - 1):
        total = np.zeros(WIDTH)
        for row in range(groups[group], groups[group + 1]):
            scale = sigma[0] + sigma[1] * features[row, 1] + sigma[2] * features[row, 2]
            variance = max(scale, least[0]) ** 2 + least[1]
            weight = 1.0 / variance
            add_point(total, basis[row, 0], basis[row, 1], basis[row, 2], weight)
            wz = weight * errors[row]
            total[_WZ] += wz
            for i in range(3):
                total[_WZB + i] += wz * basis[row, i]
            total[SQUARES] += wz * errors[row]
            total[LOGARITHMS] += np.log(variance)
        sums[group] = total


@compiled
def eliminate_cell_biases(
    columns: Columns,
    sums: Floats,
    variance: float,
    matrix: Floats,
    right: Floats,
) -> tuple[float, float]:
    """Add up the normal equations of the errors z, with the biases of cells eliminated.

    ``X' V^-1 X`` is added to `matrix` (p, p), and ``X' V^-1 z`` to `right` (p,). The covariance V
    of the errors is the diagonal of the rays' variances, plus `variance` for each pair of returns
    in a cell; the Sherman-Morrison formula inverts V. Returns the decrease of ``z' V^-1 z`` and the
    increase of ``log |V|`` that the cells' biases cause.

    Parameters
    ----------
    columns
        Cell, surface and biases of each group.
    sums
        The result of `group_sums`.
    variance
        Variance of the cells' biases, m^2.
    matrix, right
        The normal equations, which are changed in place.
    """
    cell, surface, laser, scan = columns
    taken, added, first = 0.0, 0.0, 0
    while first < len(cell):
        last = first
        weight, product = 0.0, 0.0
        while last < len(cell) and cell[last] == cell[first]:
            _add_group(surface[last], laser[last], scan[last], sums[last], matrix, right)
            weight += sums[last, _W]
            product += sums[last, _WZ]
            last += 1
        shrunk = variance / (1.0 + variance * weight)
        taken += shrunk * product * product
        added += np.log1p(variance * weight)
        _take_cell(first, last, columns, sums, (shrunk, weight, product), matrix, right)
        first = last
    return taken, added


@compiled
def _add_group(
    surface: int, laser: int, scan: int, sums: Floats, matrix: Floats, right: Floats
) -> None:
    at, pair = 3 * surface, _WBB
    for i in range(3):
        for j in range(i, 3):
            matrix[at + i, at + j] += sums[pair]
            if i != j:
                matrix[at + j, at + i] += sums[pair]
            pair += 1
        right[at + i] += sums[_WZB + i]
    for column in (laser, scan):
        for i in range(3):
            matrix[at + i, column] += sums[_WB + i]
            matrix[column, at + i] += sums[_WB + i]
        right[column] += sums[_WZ]
        for other in (laser, scan):
            matrix[column, other] += sums[_W]


@compiled
def _take_cell(
    first: int,
    last: int,
    columns: Columns,
    sums: Floats,
    about: tuple[float, float, float],
    matrix: Floats,
    right: Floats,
) -> None:
    shrunk, weight, product = about
    width = 3 * (last - first) + 2
    place, outer = np.empty(width, dtype=np.int64), np.empty(width)
    place[0], place[1] = columns.laser[first], columns.scan[first]
    outer[0], outer[1] = weight, weight
    for group in range(first, last):
        for i in range(3):
            at = 2 + 3 * (group - first) + i
            place[at] = 3 * columns.surface[group] + i
            outer[at] = sums[group, _WB + i]
    for i in range(width):
        right[place[i]] -= shrunk * outer[i] * product
        for j in range(width):
            matrix[place[i], place[j]] -= shrunk * outer[i] * outer[j]


@compiled
def eliminate_scan_biases(
    core: int, variance: float, matrix: Floats, right: Floats
) -> tuple[float, float]:
    """Eliminate the lasers' biases in single scans from the normal equations.

    The biases are normally distributed, and no equation contains two of them. Returns the decrease
    of ``z' V^-1 z`` and the increase of ``log |V|`` that they cause.

    Parameters
    ----------
    core
        First matrix column of these biases; they occupy all columns from there on.
    variance
        Variance of the biases.
    matrix, right
        The normal equations, which are changed in place.
    """
    taken, added = 0.0, 0.0
    for scan in range(core, len(matrix)):
        precision = matrix[scan, scan]
        shrunk = variance / (1.0 + variance * precision)
        taken += shrunk * right[scan] * right[scan]
        added += np.log1p(variance * precision)
        columns = np.flatnonzero(matrix[scan, :core])
        for i in columns:
            right[i] -= shrunk * matrix[scan, i] * right[scan]
            for j in columns:
                matrix[i, j] -= shrunk * matrix[scan, i] * matrix[scan, j]
    return taken, added


@compiled
def solved(matrix: Floats, right: Floats) -> tuple[float, float]:
    """Return ``log |A|`` and ``b' A^-1 b`` for A = `matrix` and b = `right`.

    Both numbers are nan if A is not positive definite.
    """
    lower, y = matrix.copy(), right.copy()
    factorise(lower, -np.inf)
    substitute(lower, y)
    determinant, product = 0.0, 0.0
    for i in range(len(matrix)):
        if not lower[i, i] ** 2 > 1e-12 * matrix[i, i]:
            return np.nan, np.nan
        determinant += 2.0 * np.log(lower[i, i])
        product += y[i] * y[i]
    return determinant, product

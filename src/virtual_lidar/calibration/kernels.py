"""Compiled loops of the likelihood: sums over returns, and elimination of random biases.

A return's row of the design matrix has five non-zero entries: three coefficients (b0, b1, b2) of
its plane, 1 for the laser's bias, and 1 for the laser's bias in the scan.
"""

from __future__ import annotations

import numpy as np

from pointkit.compiling import compiled
from pointkit.geometry.cloud import Floats
from virtual_lidar.calibration.observations import Codes

# Columns of the sums of a group: w = 1 / variance, b the basis, z the error.
WIDTH = 16
_W, _WB, _WBB, _WZ, _WZB = 0, 1, 4, 10, 11
SQUARES, LOGARITHMS = 14, 15


@compiled
def group_sums(
    groups: Codes,
    values: tuple[Floats, Floats, Floats],
    sigma: tuple[float, float, float],
    least: tuple[float, float],
    sums: Floats,
) -> None:
    """Sum the terms of the normal equations over each group of returns, in `sums` (g, 16).

    For weight w = 1 / variance, basis b and error z, the terms are w, w b (3), w b b (6), w z,
    w z b (3), w z z and the log variance. `groups` (g + 1,) are the groups' first rows, and n;
    `values` are errors (n,), basis (n, 3) and features (n, 3). The standard deviation, m, is the
    scalar product of features and `sigma`, at least ``least[0]``; ``least[1]`` is added to the
    variance.
    """
    errors, basis, features = values
    for group in range(len(groups) - 1):
        total = np.zeros(16)
        for row in range(groups[group], groups[group + 1]):
            scale = sigma[0] + sigma[1] * features[row, 1] + sigma[2] * features[row, 2]
            variance = max(scale, least[0]) ** 2 + least[1]
            weight, b0, b1, b2 = 1.0 / variance, basis[row, 0], basis[row, 1], basis[row, 2]
            w0, w1, w2, wz = weight * b0, weight * b1, weight * b2, weight * errors[row]
            total[0] += weight
            total[1] += w0
            total[2] += w1
            total[3] += w2
            total[4] += w0 * b0
            total[5] += w0 * b1
            total[6] += w0 * b2
            total[7] += w1 * b1
            total[8] += w1 * b2
            total[9] += w2 * b2
            total[10] += wz
            total[11] += wz * b0
            total[12] += wz * b1
            total[13] += wz * b2
            total[14] += wz * errors[row]
            total[15] += np.log(variance)
        sums[group] = total


@compiled
def absorb_cells(
    codes: tuple[Codes, Codes, Codes, Codes],
    sums: Floats,
    variance: float,
    matrix: Floats,
    right: Floats,
) -> tuple[float, float]:
    """Add ``X' V^-1 X`` to `matrix` (p, p) and ``X' V^-1 z`` to `right` (p,).

    The covariance V of the errors z is the diagonal of the rays' variances, plus `variance` for
    each pair of returns in a cell; the Sherman-Morrison formula inverts V. `codes` are each group's
    cell, surface, matrix column of the laser, and matrix column of the laser in its scan.
    Returns the decrease of ``z' V^-1 z`` and the increase of ``log |V|`` due to the cells' biases.
    """
    cell, surface, laser, scan = codes
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
        _take_cell(first, last, codes, sums, (shrunk, weight, product), matrix, right)
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
    codes: tuple[Codes, Codes, Codes, Codes],
    sums: Floats,
    about: tuple[float, float, float],
    matrix: Floats,
    right: Floats,
) -> None:
    shrunk, weight, product = about
    width = 3 * (last - first) + 2
    columns, outer = np.empty(width, dtype=np.int64), np.empty(width)
    columns[0], columns[1] = codes[2][first], codes[3][first]
    outer[0], outer[1] = weight, weight
    for group in range(first, last):
        for i in range(3):
            at = 2 + 3 * (group - first) + i
            columns[at] = 3 * codes[1][group] + i
            outer[at] = sums[group, _WB + i]
    for i in range(width):
        right[columns[i]] -= shrunk * outer[i] * product
        for j in range(width):
            matrix[columns[i], columns[j]] -= shrunk * outer[i] * outer[j]


@compiled
def absorb_scans(core: int, variance: float, matrix: Floats, right: Floats) -> tuple[float, float]:
    """Eliminate the scan biases, the columns from `core` on, from the equations.

    Scan biases are normally distributed with variance `variance`; no equation contains two. Returns
    the decrease of ``z' V^-1 z`` and the increase of ``log |V|`` due to them.
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

    Both are nan unless A is positive definite.
    """
    size = len(matrix)
    lower, y = np.zeros((size, size)), np.zeros(size)
    determinant, product = 0.0, 0.0
    for i in range(size):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= lower[i, k] * lower[j, k]
            if i != j:
                lower[i, j] = rest / lower[j, j]
            elif rest > 1e-12 * matrix[i, i]:
                lower[i, i] = np.sqrt(rest)
            else:
                return np.nan, np.nan
        value = right[i]
        for k in range(i):
            value -= lower[i, k] * y[k]
        y[i] = value / lower[i, i]
        determinant += 2.0 * np.log(lower[i, i])
        product += y[i] * y[i]
    return determinant, product

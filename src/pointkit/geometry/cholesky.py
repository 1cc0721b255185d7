"""Cholesky decomposition of small matrices, with the same result on every processor.

Libraries of linear algebra round differently on different processors; these loops do not.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from pointkit.compiling import compiled_in_place, inlined
from pointkit.geometry.cloud import Floats


@inlined
def factorise(matrix: Floats, least: float) -> None:
    """Replace the lower triangle of a symmetric matrix (n, n) by its Cholesky factor.

    Parameters
    ----------
    matrix
        The matrix, which is overwritten.
    least
        Least value of the squares of the factor's diagonal.
    """
    for i in range(len(matrix)):
        for j in range(i + 1):
            residual = matrix[i, j]
            for k in range(j):
                residual -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(max(residual, least)) if i == j else residual / matrix[j, j]


@inlined
def substitute(factor: Floats, right: Floats) -> None:
    """Solve ``factor @ x = right`` for a lower triangular factor, and write x to `right`."""
    for i in range(len(right)):
        for k in range(i):
            right[i] -= factor[i, k] * right[k]
        right[i] /= factor[i, i]


@partial(compiled_in_place, error_model="numpy")
def solve(matrix: Floats, right: Floats, least: float = -np.inf) -> None:
    """Solve ``matrix @ x = right``; x (n,) replaces `right`, and the factor replaces `matrix`."""
    factorise(matrix, least)
    substitute(matrix, right)
    for i in range(len(right) - 1, -1, -1):
        for k in range(i + 1, len(right)):
            right[i] -= matrix[k, i] * right[k]
        right[i] /= matrix[i, i]

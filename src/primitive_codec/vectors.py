"""Vectors of three numbers for compiled loops.

The vectors are tuples, because these need no heap memory.
"""

from __future__ import annotations

import numpy as np

from pointkit.compiling import inlined
from pointkit.geometry.cloud import Floats

Vector = tuple[float, float, float]


@inlined
def row_of(array: Floats, i: int) -> Vector:
    """Return row i of an array (n, 3) as a vector."""
    return array[i, 0], array[i, 1], array[i, 2]


@inlined
def vector(array: Floats) -> Vector:
    """Return an array (3,) as a vector."""
    return array[0], array[1], array[2]


@inlined
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def length(a: Vector) -> float:
    """Return the Euclidean length of a vector."""
    return float(np.sqrt(dot(a, a)))


@inlined
def add_multiple(a: Vector, factor: float, b: Vector) -> Vector:
    """Return a + factor * b."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@inlined
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def multiply(factor: float, a: Vector) -> Vector:
    """Return factor * a."""
    return factor * a[0], factor * a[1], factor * a[2]

"""Vectors of three numbers in compiled loops: tuples, which need no memory of their own."""

from __future__ import annotations

import numpy as np

from puckbench.core.compiling import inlined
from puckbench.geometry.cloud import Floats

Vector = tuple[float, float, float]


@inlined
def row_of(array: Floats, i: int) -> Vector:
    """Row i of an array (n, 3)."""
    return array[i, 0], array[i, 1], array[i, 2]


@inlined
def vector(array: Floats) -> Vector:
    """An array (3,)."""
    return array[0], array[1], array[2]


@inlined
def dot(a: Vector, b: Vector) -> float:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def length(a: Vector) -> float:
    """Euclidean norm."""
    return float(np.sqrt(dot(a, a)))


@inlined
def add_multiple(a: Vector, far: float, b: Vector) -> Vector:
    """`a` and `far` times `b` on top of it."""
    return a[0] + far * b[0], a[1] + far * b[1], a[2] + far * b[2]


@inlined
def cross(a: Vector, b: Vector) -> Vector:
    """Cross product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def multiply(far: float, a: Vector) -> Vector:
    """`far` times `a`."""
    return far * a[0], far * a[1], far * a[2]

"""Manhattan frame: the three orthogonal axes that walls and floors of a scene are aligned with."""

from __future__ import annotations

from math import cos, hypot, radians, sin

import numpy as np

from puckbench.core.compiling import compiled
from puckbench.geometry.cloud import Floats
from puckbench.primitives.distortion import subset

RotationVector = tuple[int, int, int]
"""A rotation vector (axis times angle) in steps of `STEP` radians."""
STEP = np.pi / 32767
_MAX_NORMALS = 4000
"""Normals that are looked at."""
_INITIAL_STEP_DEG = 7.5
_TOLERANCE = radians(2.0)
_COSINES = tuple(cos(radians(degrees)) for degrees in (20.0, 10.0, 5.0, 4.0, 3.0))
_INERTIA = 1e-7
"""Weight of the rotation so far, which decides what the normals leave open, as of a single wall."""
_MAX_ITERATIONS = 60
_MIN_GAIN, _MIN_BETTER = 0.02, 1e-6
"""Alignment that a rotation has to gain over none, and over another one."""


def rotation_matrix(rotation_vector: RotationVector) -> Floats:
    """Rotation matrix (3, 3), for column vectors, of a rotation vector (Rodrigues' formula)."""
    x, y, z = (STEP * number for number in rotation_vector)
    angle = hypot(x, y, z)
    if angle == 0:
        return np.eye(3)
    x, y, z = x / angle, y / angle, z / angle
    s, c = sin(angle), 1 - cos(angle)
    return np.array(
        [
            [1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y],
            [c * x * y + s * z, 1 - c * (x * x + z * z), c * y * z - s * x],
            [c * x * z - s * y, c * y * z + s * x, 1 - c * (x * x + y * y)],
        ]
    )


@compiled
def rotated(vectors: Floats, rotation: Floats) -> Floats:
    """Vectors (n, 3) after a rotation (3, 3), bit for bit the same on every processor."""
    found = np.empty_like(vectors)
    for i in range(len(vectors)):
        x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        for a in range(3):
            found[i, a] = rotation[a, 0] * x + rotation[a, 1] * y + rotation[a, 2] * z
    return found


def rotated_back(vectors: Floats, rotation: Floats) -> Floats:
    """Vectors (n, 3) before a rotation (3, 3)."""
    return rotated(vectors, np.ascontiguousarray(rotation.T))


def estimate_manhattan_frame(normals: Floats) -> RotationVector:
    """Rotation after which most normals are parallel to the axes.

    Parameters
    ----------
    normals
        (n, 3) unit normals of the surface.

    Returns
    -------
    RotationVector
        From the cloud's axes to the scene's; zeros where a rotation gains little.
    """
    chosen = subset(normals, _MAX_NORMALS)
    best, best_share = (0, 0, 0), _alignment(chosen, np.eye(3)) + _MIN_GAIN
    for axis in range(3):
        for degrees in np.arange(0, 90, _INITIAL_STEP_DEG):
            vector = np.zeros(3)
            vector[axis] = np.radians(degrees) / STEP
            rotation_vector = _quantise(_refine(chosen, rotation_matrix(_rounded(vector))))
            share = _alignment(chosen, rotation_matrix(rotation_vector))
            if share > best_share + _MIN_BETTER:
                best, best_share = rotation_vector, share
    return best


@compiled
def _alignment(normals: Floats, rotation: Floats) -> float:
    """Share of the normals parallel to an axis, weighted by their angles to it."""
    total = 0.0
    turned = rotated(normals, rotation)
    for i in range(len(turned)):
        cosine = max(abs(turned[i, 0]), abs(turned[i, 1]), abs(turned[i, 2]))
        total += np.exp(-2 * (1 - min(cosine, 1.0)) / _TOLERANCE**2)
    return float(total / len(turned))


@compiled
def _refine(normals: Floats, rotation: Floats) -> Floats:
    """Rotation near a given one that maps normals near an axis onto it (Kabsch 1976)."""
    rotation = rotation.copy()
    for least in _COSINES:
        sums, count = np.zeros((3, 3)), 0
        turned = rotated(normals, rotation)
        for i in range(len(turned)):
            axis = np.abs(turned[i]).argmax()
            if abs(turned[i, axis]) > least:
                sign = 1.0 if turned[i, axis] > 0 else -1.0
                count += 1
                for a in range(3):
                    sums[axis, a] += sign * normals[i, a]
        if not _find_nearest_rotation(sums + _INERTIA * count * rotation, rotation):
            break
    return rotation


@compiled
def _find_nearest_rotation(matrix: Floats, rotation: Floats) -> bool:
    """Write the rotation nearest to a matrix (3, 3), by Newton's iteration (Higham 1986).

    False, and nothing is written, where the matrix is singular or turns space inside out.
    """
    for _ in range(_MAX_ITERATIONS):
        cofactors = np.empty((3, 3))
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                cofactors[i, a] = matrix[j, b] * matrix[k, c] - matrix[j, c] * matrix[k, b]
        volume = (matrix[0] * cofactors[0]).sum()
        if volume <= 0.0:
            return False
        before, matrix = matrix, (matrix + cofactors / volume) / 2
        if np.abs(matrix - before).max() < 1e-12:
            break
    rotation[:] = matrix
    return True


def _quantise(rotation: Floats) -> RotationVector:
    """The nearest rotation vector of least angle that maps the axes to the same lines."""
    order = np.abs(rotation).argmax(axis=1)
    if len(set(order.tolist())) == 3:
        rows = np.argsort(order)
        rotation = rotation[rows] * np.sign(rotation[rows, np.arange(3)])[:, None]
    if np.linalg.det(rotation) < 0:
        return (0, 0, 0)
    angle = np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))
    skew = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0]])
    skew = np.append(skew, rotation[1, 0] - rotation[0, 1])
    length = np.linalg.norm(skew)
    return _rounded(skew / length * angle / STEP) if length > 0 else (0, 0, 0)


def _rounded(vector: Floats) -> RotationVector:
    x, y, z = np.rint(vector).astype(int).tolist()
    return (x, y, z)

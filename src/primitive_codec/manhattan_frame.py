"""Estimation of a Manhattan frame: the three orthogonal axes of a scene's walls and floors."""

from __future__ import annotations

from math import cos, hypot, radians, sin

import numpy as np

from pointkit.compiling import compiled
from pointkit.geometry.cloud import Floats
from primitive_codec.distortion import subsample

RotationVector = tuple[int, int, int]
"""Rotation vector (axis times angle) in steps of `ROTATION_STEP` radians."""
ROTATION_STEP = np.pi / 32767
_MAX_NORMALS = 4000
_INITIAL_STEP_DEG = 7.5
_TOLERANCE = radians(2.0)
_MIN_COSINES = tuple(cos(radians(degrees)) for degrees in (20.0, 10.0, 5.0, 4.0, 3.0))
_PRIOR_WEIGHT = 1e-7
"""Weight of the current rotation, which decides angles that the normals leave open, for example
around a single wall's normal."""
_MAX_ITERATIONS = 60
_MIN_GAIN, _MIN_IMPROVEMENT = 0.02, 1e-6
"""Least gain in the share of aligned normals over no rotation, and over the best previous
rotation."""


def rotation_matrix(rotation_vector: RotationVector) -> Floats:
    """Return the rotation matrix (3, 3) of a quantised rotation vector."""
    x, y, z = (ROTATION_STEP * number for number in rotation_vector)
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
def rotate(vectors: Floats, rotation: Floats) -> Floats:
    """Rotate vectors (n, 3) by a matrix (3, 3), with identical results on all processors."""
    result = np.empty_like(vectors)
    for i in range(len(vectors)):
        x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        for a in range(3):
            result[i, a] = rotation[a, 0] * x + rotation[a, 1] * y + rotation[a, 2] * z
    return result


def rotate_inverse(vectors: Floats, rotation: Floats) -> Floats:
    """Rotate vectors (n, 3) by the inverse of a rotation matrix (3, 3)."""
    return rotate(vectors, np.ascontiguousarray(rotation.T))


def estimate_manhattan_frame(normals: Floats) -> RotationVector:
    """Find the rotation that aligns most surface normals with the coordinate axes.

    Parameters
    ----------
    normals
        Unit normals (n, 3).

    Returns
    -------
    tuple of int
        Rotation vector (axis times angle) in steps of `ROTATION_STEP` radians. It is zero if no
        rotation aligns many more normals than are aligned already.
    """
    sampled = subsample(normals, _MAX_NORMALS)
    best, least_share = (0, 0, 0), _aligned_share(sampled, np.eye(3)) + _MIN_GAIN
    for axis in range(3):
        for degrees in np.arange(0, 90, _INITIAL_STEP_DEG):
            vector = np.zeros(3)
            vector[axis] = np.radians(degrees) / ROTATION_STEP
            rotation_vector = _quantise(_refine(sampled, rotation_matrix(_round(vector))))
            share = _aligned_share(sampled, rotation_matrix(rotation_vector))
            if share > least_share + _MIN_IMPROVEMENT:
                best, least_share = rotation_vector, share
    return best


@compiled
def _aligned_share(normals: Floats, rotation: Floats) -> float:
    total = 0.0
    turned_normals = rotate(normals, rotation)
    for i in range(len(turned_normals)):
        x, y, z = turned_normals[i]
        cosine = max(abs(x), abs(y), abs(z))
        total += np.exp(-2 * (1 - min(cosine, 1.0)) / _TOLERANCE**2)
    return float(total / len(turned_normals))


@compiled
def _refine(normals: Floats, rotation: Floats) -> Floats:
    """Refine a rotation by aligning each normal with its nearest axis (Kabsch 1976)."""
    # Each iteration uses normals within a smaller angle of an axis.
    rotation = rotation.copy()
    for min_cosine in _MIN_COSINES:
        sums, count = np.zeros((3, 3)), 0
        turned_normals = rotate(normals, rotation)
        for i in range(len(turned_normals)):
            axis = np.abs(turned_normals[i]).argmax()
            if abs(turned_normals[i, axis]) > min_cosine:
                sign = 1.0 if turned_normals[i, axis] > 0 else -1.0
                count += 1
                for a in range(3):
                    sums[axis, a] += sign * normals[i, a]
        if not _project_to_rotation(sums + _PRIOR_WEIGHT * count * rotation, rotation):
            break
    return rotation


@compiled
def _project_to_rotation(matrix: Floats, rotation: Floats) -> bool:
    """Replace `rotation` by the rotation nearest to a matrix (Newton's iteration, Higham 1986)."""
    # Returns False if the matrix is singular or a reflection.
    for _ in range(_MAX_ITERATIONS):
        cofactors = np.empty((3, 3))
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                cofactors[i, a] = matrix[j, b] * matrix[k, c] - matrix[j, c] * matrix[k, b]
        determinant = (matrix[0] * cofactors[0]).sum()
        if determinant <= 0.0:
            return False
        previous, matrix = matrix, (matrix + cofactors / determinant) / 2
        if np.abs(matrix - previous).max() < 1e-12:
            break
    rotation[:] = matrix
    return True


def _quantise(rotation: Floats) -> RotationVector:
    """Quantise a rotation, after axes are exchanged and reversed so that its angle is least."""
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
    return _round(skew / length * angle / ROTATION_STEP) if length > 0 else (0, 0, 0)


def _round(vector: Floats) -> RotationVector:
    x, y, z = np.rint(vector).astype(int).tolist()
    return (x, y, z)

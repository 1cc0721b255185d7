"""Manhattan frame: the three orthogonal axes that walls and floors of a scene are aligned with."""

from __future__ import annotations

import numpy as np

from puckbench.geometry.cloud import Floats

RotationVector = tuple[int, int, int]
"""A rotation vector (axis times angle) in steps of `STEP` radians."""
STEP = np.pi / 32767
_MAX_NORMALS = 4000
"""Normals that are looked at."""
_INITIAL_STEP_DEG = 7.5
_TOLERANCE_DEG = 2.0
_MIN_GAIN = 0.02
"""Alignment that a rotation has to gain."""


def rotation_matrix(rotation_vector: RotationVector) -> Floats:
    """Rotation matrix (3, 3), for column vectors, of a rotation vector (Rodrigues' formula)."""
    vector = np.array(rotation_vector) * STEP
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


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
    subset = normals[:: -(-len(normals) // _MAX_NORMALS)]
    best, best_share = (0, 0, 0), _alignment(subset, np.eye(3)) + _MIN_GAIN
    for axis in range(3):
        for degrees in np.arange(0, 90, _INITIAL_STEP_DEG):
            vector = np.zeros(3)
            vector[axis] = np.radians(degrees) / STEP
            rotation_vector = _quantise(_refine(subset, rotation_matrix(_rounded(vector))))
            share = _alignment(subset, rotation_matrix(rotation_vector))
            if share > best_share + 1e-9:
                best, best_share = rotation_vector, share
    return best


def _alignment(normals: Floats, rotation: Floats) -> float:
    """Share of the normals parallel to an axis, weighted by their angles to it."""
    cosines = np.abs(normals @ rotation.T).max(axis=1).clip(0, 1)
    return float(np.mean(np.exp(-2 * (1 - cosines) / np.radians(_TOLERANCE_DEG) ** 2)))


def _refine(normals: Floats, rotation: Floats) -> Floats:
    """Rotation near a given one that maps normals near an axis onto it (Kabsch 1976)."""
    for degrees in (20.0, 10.0, 5.0, 4.0, 3.0):
        projections = normals @ rotation.T
        rows, axis = np.arange(len(projections)), np.abs(projections).argmax(axis=1)
        near = np.abs(projections[rows, axis]) > np.cos(np.radians(degrees))
        if not near.any():
            break
        target = np.zeros_like(projections)
        target[rows, axis] = np.sign(projections[rows, axis])
        u, _, v = np.linalg.svd(target[near].T @ normals[near])
        rotation = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    return np.asarray(rotation)


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

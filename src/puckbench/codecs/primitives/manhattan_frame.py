"""The axes that a cloud's surfaces keep to: walls and floors at right angles, turned or not."""

from __future__ import annotations

import numpy as np

from puckbench.geometry.cloud import Floats

Turn = tuple[int, int, int]
"""A rotation vector in steps of `STEP` radians."""
STEP = np.pi / 32767
_SEEN = 4000
"""Normals that are looked at."""
_START_DEG = 7.5
_SHARP_DEG = 2.0
_WORTH = 0.02
"""Share of the surface that has to come to lie along the axes for a turn to pay."""


def rotation(turn: Turn) -> Floats:
    """The rotation (3, 3) of a turn, for column vectors (Rodrigues' formula)."""
    vector = np.array(turn) * STEP
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def best_turn(normals: Floats) -> Turn:
    """The turn after which most normals (n, 3) lie along the axes; none where it gains little."""
    seen = normals[:: -(-len(normals) // _SEEN)]
    best, most = (0, 0, 0), _aligned(seen, np.eye(3)) + _WORTH
    for axis in range(3):
        for degrees in np.arange(0, 90, _START_DEG):
            vector = np.zeros(3)
            vector[axis] = np.radians(degrees) / STEP
            turn = _quantised(_refined(seen, rotation(_whole(vector))))
            share = _aligned(seen, rotation(turn))
            if share > most + 1e-9:
                best, most = turn, share
    return best


def _aligned(normals: Floats, turned: Floats) -> float:
    """Share of the normals along an axis, those some degrees off for less."""
    most = np.abs(normals @ turned.T).max(axis=1).clip(0, 1)
    return float(np.mean(np.exp(-2 * (1 - most) / np.radians(_SHARP_DEG) ** 2)))


def _refined(normals: Floats, turned: Floats) -> Floats:
    """Rotation near to one given that brings the normals near an axis onto it (Kabsch 1976)."""
    for degrees in (20.0, 10.0, 5.0, 4.0, 3.0):
        along = normals @ turned.T
        rows, axis = np.arange(len(along)), np.abs(along).argmax(axis=1)
        near = np.abs(along[rows, axis]) > np.cos(np.radians(degrees))
        if not near.any():
            break
        target = np.zeros_like(along)
        target[rows, axis] = np.sign(along[rows, axis])
        u, _, v = np.linalg.svd(target[near].T @ normals[near])
        turned = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    return np.asarray(turned)


def _quantised(turned: Floats) -> Turn:
    """The nearest turn, that of the least angle that maps the axes to the same lines."""
    order = np.abs(turned).argmax(axis=1)
    if len(set(order.tolist())) == 3:
        rows = np.argsort(order)
        turned = turned[rows] * np.sign(turned[rows, np.arange(3)])[:, None]
    if np.linalg.det(turned) < 0:
        return (0, 0, 0)
    angle = np.arccos(np.clip((np.trace(turned) - 1) / 2, -1, 1))
    skew = np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0]])
    skew = np.append(skew, turned[1, 0] - turned[0, 1])
    length = np.linalg.norm(skew)
    return _whole(skew / length * angle / STEP) if length > 0 else (0, 0, 0)


def _whole(vector: Floats) -> Turn:
    x, y, z = np.rint(vector).astype(int).tolist()
    return (x, y, z)

"""One turn of a small sensor in a box-shaped room, in mm: the source of vectors of G-PCC."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpcc.sensor import SensorDescription

STEPS = 450
ELEVATIONS_DEG, HEIGHTS_MM = np.linspace(-15, 15, 8), np.linspace(8, -8, 8)
SENSOR = SensorDescription(
    tuple(np.tan(np.radians(ELEVATIONS_DEG)).tolist()), tuple(HEIGHTS_MM.tolist()), STEPS
)


def small_turn() -> NDArray[np.float64]:
    """Points (n, 3) of a room of 8 m by 6 m by 3 m, with noise, whole numbers."""
    random = np.random.default_rng(0)
    angle = np.radians(np.arange(STEPS) * 360 / STEPS)[:, None]
    up = np.radians(ELEVATIONS_DEG)
    walls = np.maximum(np.abs(np.sin(angle)) / 3000, np.abs(np.cos(angle)) / 4000) * np.cos(up)
    far = 1 / np.maximum(walls, np.abs(np.sin(up)) / 1500) + random.normal(0, 6, (STEPS, 8))
    x, y = far * np.cos(up) * np.cos(angle), far * np.cos(up) * np.sin(angle)
    points = np.stack([x, y, far * np.sin(up) + HEIGHTS_MM], axis=-1)
    return np.asarray(np.rint(points[random.random(far.shape) < 0.6]))

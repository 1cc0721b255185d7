from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats

MARGIN_M = 1e-6
"""Margin, in metres, that keeps walls on a face of the box despite rounding."""


def inside_box(points: Floats, box: Floats, margin: float = MARGIN_M) -> NDArray[np.bool_]:
    """Return the mask (n,) of points in a box (2, 3) widened by `margin`, in m (thesis, 6.1.3)."""
    low, high = box[0] - margin, box[1] + margin
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))

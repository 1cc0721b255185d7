"""Cropping to an axis-aligned box, as the thesis crops a scan to its room (section 6.1.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats

MARGIN_M = 1e-6
"""Tolerance of the box's faces: a wall that bounds the box belongs to the room."""


def inside(points: Floats, box: Floats, margin: float = MARGIN_M) -> NDArray[np.bool_]:
    """Mask (n,) of the points (n, 3) within a box.

    Parameters
    ----------
    points
        (n, 3), metres.
    box
        Lowest and highest corner, (2, 3), metres.
    margin
        Distance by which the box is widened on all sides, metres.
    """
    low, high = box[0] - margin, box[1] + margin
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))

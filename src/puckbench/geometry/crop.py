from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats

MARGIN_M = 1e-6
"""By how much a box is widened, in m, so that rounding does not remove walls on its faces."""


def inside_box(points: Floats, box: Floats, margin: float = MARGIN_M) -> NDArray[np.bool_]:
    """Determine which points lie inside a box (thesis, section 6.1.3).

    Parameters
    ----------
    points
        Coordinates, (n, 3), in m.
    box
        The lowest and the highest corner of the box, (2, 3), in m.
    margin
        Length by which the box is widened on every side, in m.

    Returns
    -------
    numpy.ndarray
        Whether each point lies inside, (n,), Boolean.
    """
    low, high = box[0] - margin, box[1] + margin
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))

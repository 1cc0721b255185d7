"""The points of a scan, checked."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError


def checked_points(xyz: NDArray[Any]) -> NDArray[Any]:
    """Return the points of a scan, (n, 3), as an array.

    Raises InputError if they have another shape, or are not finite numbers.
    """
    points = np.asarray(xyz)
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise InputError(f"the scan is an array {points.shape}, but must be numbers (n, 3)")
    if not np.isfinite(points).all():
        raise InputError("the scan has points that are not finite")
    return points

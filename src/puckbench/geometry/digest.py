from __future__ import annotations

import hashlib

import numpy as np

from pointkit.geometry.cloud import Floats

_STEPS_PER_UNIT = {"scaled": 1e3, "metric": 1e6}
"""Number of steps per unit to which coordinates are rounded: thousandths of a grid unit of scaled
clouds, or micrometres of metric clouds.
"""


def cloud_digest(points: Floats, metric: bool = False) -> str:
    """Return a digest by which clouds with equal points in equal order are recognised.

    Coordinates are rounded before, because processors may differ in the last bits.

    Parameters
    ----------
    points
        Coordinates, (n, 3).
    metric
        Whether coordinates are in m; otherwise, they are in grid units.

    Returns
    -------
    str
        The first 32 hexadecimal digits of the SHA-256 of the rounded coordinates.
    """
    steps = np.rint(points * _STEPS_PER_UNIT["metric" if metric else "scaled"]).astype("<i8")
    return hashlib.sha256(steps.tobytes()).hexdigest()[:32]

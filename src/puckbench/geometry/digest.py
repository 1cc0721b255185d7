from __future__ import annotations

import hashlib

import numpy as np

from pointkit.geometry.cloud import Floats

_STEPS_PER_UNIT = {"scaled": 1e3, "metric": 1e6}
"""Steps to which coordinates are rounded: thousandths of a grid unit, or micrometres."""


def cloud_digest(points: Floats, metric: bool = False) -> str:
    """Return 32 hexadecimal digits of the SHA-256 of a cloud's ordered coordinates (n, 3).

    Coordinates are rounded, because processors may differ in the last bits.
    """
    steps = np.rint(points * _STEPS_PER_UNIT["metric" if metric else "scaled"]).astype("<i8")
    return hashlib.sha256(steps.tobytes()).hexdigest()[:32]

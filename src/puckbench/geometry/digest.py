"""Digests of clouds, by which results on the same cloud are known to be so."""

from __future__ import annotations

import hashlib

import numpy as np

from puckbench.geometry.cloud import Floats

_STEPS = {"scaled": 1e3, "metric": 1e6}
"""To a unit of coordinates: thousandths of a grid unit, micrometres."""


def cloud_digest(points: Floats, metric: bool = False) -> str:
    """The digest of a cloud's coordinates, in the order of its points.

    Coordinates are rounded first, far below what any codec or metric tells apart: processors of
    different kinds may differ in the last bits of the same scan.

    Parameters
    ----------
    points : (n, 3)
        Coordinates, in grid units or metres.
    metric
        Whether these are metres.

    Returns
    -------
    str
        32 hexadecimal digits of SHA-256.
    """
    steps = np.rint(points * _STEPS["metric" if metric else "scaled"]).astype("<i8")
    return hashlib.sha256(steps.tobytes()).hexdigest()[:32]

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import NARROWER, InputError
from pointkit.geometry.cloud import Floats
from puckbench.codecs.most_points import most_points

_POINTS_PER_BYTE = 256
_FEW_POINTS = 65536
MOST_STEPS = float(2**30)
"""Largest extent, in steps, that `in_steps` accepts of a cloud within a kilometre of the origin."""


def in_steps(points: Floats, step: float) -> NDArray[np.int64]:
    """Round points (n, 3) in m to integer multiples (n, 3) of a step in m.

    Raises InputError if they exceed 31 bits.
    """
    check_steps(points, step)
    return np.rint(points / step).astype(np.int64)


def check_steps(points: Floats, step: float) -> None:
    """Raise InputError if points (n, 3) exceed 31 bits as multiples of a step, both in m."""
    if np.abs(points).max() / step >= 2**31 - 1:
        raise InputError(f"the cloud reaches beyond 2^31 steps of {step:g} m{NARROWER}")


def check_points_of(count: int, stream: bytes) -> None:
    """Raise InputError if the number of points is implausible for the size of the stream."""
    few = _FEW_POINTS + _POINTS_PER_BYTE * len(stream)
    if not 0 < count <= min(few, most_points(len(stream))):
        raise InputError(f"{count} points in {len(stream)} bytes: more than a stream can hold")

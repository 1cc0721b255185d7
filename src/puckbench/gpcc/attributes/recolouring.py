"""Values of points whose positions were changed or merged, from those of the source's points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Source(NamedTuple):
    """Points (n, 3) whose positions in the coded cloud are points * scale - offset."""

    points: NDArray[np.float64]
    scale: float
    offset: NDArray[np.float64]


def recoloured(positions, values, source, most):
    raise NotImplementedError

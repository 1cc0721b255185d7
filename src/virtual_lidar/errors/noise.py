from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from pointkit.geometry.cloud import Floats

Distribution = Literal["gaussian", "laplace"]

_DRAW: dict[str, Callable[[np.random.Generator, tuple[int, ...]], Floats]] = {
    "gaussian": lambda stream, shape: stream.standard_normal(shape),
    "laplace": lambda stream, shape: stream.laplace(size=shape),
}


def standard_noise(
    stream: np.random.Generator, shape: tuple[int, ...], distribution: Distribution
) -> Floats:
    """Draw independent numbers with mean 0 and scale 1.

    The scale is sigma of a Gaussian and, as in BlenSor, b of a Laplace distribution.
    """
    return _DRAW[distribution](stream, shape)

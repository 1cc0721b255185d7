"""Shapes of range noise: Gaussian and Laplace, each in units of its scale parameter."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from puckbench.geometry.cloud import Floats

Distribution = Literal["gaussian", "laplace"]

_DRAW: dict[str, Callable[[np.random.Generator, tuple[int, ...]], Floats]] = {
    "gaussian": lambda stream, shape: stream.standard_normal(shape),
    "laplace": lambda stream, shape: stream.laplace(size=shape),
}


def standard_noise(
    stream: np.random.Generator, shape: tuple[int, ...], distribution: Distribution
) -> Floats:
    """Draw noise with mean 0 and scale 1.

    The scale is sigma of a Gaussian and b of a Laplace distribution, whose standard deviation is
    b times the root of two, since BlenSor reads one parameter as either.

    Parameters
    ----------
    stream
        The generator that is drawn from.
    shape
        Of the array that is returned.
    distribution
        ``"gaussian"`` or ``"laplace"``.

    Returns
    -------
    Floats
        Independent numbers of the given shape.
    """
    return _DRAW[distribution](stream, shape)

"""The attributes that PoLoPCAC codes, and the numbers as which its network sees them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpcc.attributes.colours import YCGCO, coded_colours, decoded_colours
from pointkit.errors import InputError

REFLECTANCE, COLOUR = "reflectance", "colour"
Table = NDArray[np.int32]
"""Whole numbers (n, channels) of an attribute."""
_LUMA_ORANGE_GREEN = [0, 2, 1]
_CHROMA_BITS = 9


class Kind(NamedTuple):
    """How the values of an attribute are coded.

    Parameters
    ----------
    name
        Name of the attribute.
    dtype
        Type of the values in streams.
    channels
        Number of values of a point.
    levels
        Coded values are from 0 to ``levels - 1``; 0 if the network does not code them.
    peak
        Size of values: an output o of the network stands for the coded value ``(o + 0.5) * peak``.
    divisors
        Numbers by which the values of neighbours are divided.
    """

    name: str
    dtype: str
    channels: int
    levels: int
    peak: float = 0.0
    divisors: tuple[float, ...] = ()

    @property
    def largest(self) -> int:
        """Largest value of the attribute that can be coded so."""
        most = int(np.iinfo(self.dtype).max)
        return min(self.levels - 1, most) if self.levels else most


KINDS = (
    Kind(REFLECTANCE, "u1", 1, 128, 100.0, (100.0,)),
    Kind(REFLECTANCE, "u1", 1, 256, 255.0, (255.0,)),
    Kind(REFLECTANCE, "<u2", 1, 0),
    Kind(COLOUR, "u1", 3, 512, 255.0, (255.0, 511.0, 511.0)),
)
"""Reflectances of up to 127 as the authors code them, those of up to 255 as they code luma, larger
ones, and colours."""


def kind_of(name: str, values: NDArray[Any], points: int) -> Kind:
    """Return how an attribute is coded.

    Parameters
    ----------
    name
        ``reflectance`` or ``colour``.
    values
        Whole numbers: reflectances (n,) from 0 to 65,535, or red, green and blue (n, 3) from 0 to
        255.
    points
        Number of points, n.

    Raises
    ------
    InputError
        The name, the shape or a value is another.
    """
    kinds = [kind for kind in KINDS if kind.name == name]
    if not kinds:
        raise InputError(f"polopcac.encode: {name} is neither {REFLECTANCE} nor {COLOUR}")
    shape = (points,) if kinds[0].channels == 1 else (points, kinds[0].channels)
    most = kinds[-1].largest
    numbers = values.shape == shape and values.dtype.kind in "biuf"
    whole = numbers and np.isfinite(values).all() and (values == np.rint(values)).all()
    if not whole or values.min() < 0 or values.max() > most:
        raise InputError(f"polopcac.encode: {name} must be whole numbers to {most}, shape {shape}")
    return next(kind for kind in kinds if values.max() <= kind.largest)


def coded(kind: Kind, values: Table) -> Table:
    """Return values as they are coded: colours as luma, orange and green (YCoCg-R)."""
    if kind.name != COLOUR:
        return values
    return coded_colours(values, YCGCO, _CHROMA_BITS)[:, _LUMA_ORANGE_GREEN]


def uncoded(kind: Kind, table: Table) -> Table:
    """Return the values that `coded` turned into a table; a damaged table gives other values."""
    if kind.name != COLOUR:
        return table
    return decoded_colours(table[:, _LUMA_ORANGE_GREEN], YCGCO, _CHROMA_BITS)

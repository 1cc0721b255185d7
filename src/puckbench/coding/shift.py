"""Shifting of clouds that lie far from the origin, which no single precision would hold.

Surveyed coordinates (UTM) have millions of metres where a cloud spans some hundred. Such a cloud is
shifted by whole numbers before it is coded, which loses nothing, and its stream begins with

    4 bytes  "PBSH"
    the shift of each axis, a signed base-128 number

and goes on with the codec's own stream. All other streams are the codec's own from the first byte.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from puckbench.coding.byte_io import Reader, signed_128
from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats, bounds

MAGIC = b"PBSH"
_FAR = 64
"""Coordinates are far beyond this multiple of the cloud's extent: single precision then has steps
of more than a 2^18th of the extent, an eighth of a thousandth of the finest grid in use."""
_FINE = 1 << 20
"""Coordinates are far for a step beyond this multiple of it: an eighth of a step is what single
precision then tells apart. Of a cloud that is wider, errors of 2 mm at 10 km remain."""
_LONGEST = 150
"""Bytes of a shift, at most: every double's whole part has fewer."""


class Shifted(NamedTuple):
    """A codec's own stream, and by how much (3,) what it decodes to is to be shifted."""

    stream: bytes
    shift: Floats | None


def shift_of(points: Floats, step: float | None = None) -> Floats | None:
    """Whole numbers (3,) to be subtracted from points (n, 3) that are far away; else None.

    step: that of a codec in single precision, for which they may be far at a lesser distance.
    """
    ends = bounds(points)
    with np.errstate(over="ignore"):
        extent, most = float(np.ptp(ends, axis=0).max()), float(np.abs(ends).max())
        near = most <= _FAR * extent
        if step is not None and most > 2 * extent:
            near &= most <= _FINE * step
    shift: Floats = np.floor(ends[0])
    return None if near or not shift.any() else shift


def shifted(stream: bytes, shift: Floats) -> bytes:
    """The stream of a cloud from which `shift` (3,) was subtracted."""
    return MAGIC + b"".join(signed_128(int(axis)) for axis in shift) + stream


def unshifted(stream: bytes) -> Shifted:
    """A codec's own stream and the shift of its cloud; InputError when that is damaged."""
    if not stream.startswith(MAGIC):
        return Shifted(stream, None)
    reader = Reader(stream[len(MAGIC) :])
    try:
        shift = np.array([float(reader.signed(_LONGEST)) for _ in range(3)])
    except OverflowError as error:
        raise InputError("the stream is damaged (its shift)") from error
    return Shifted(reader.rest(), shift)


def moved(points: Floats, shift: Floats) -> Floats:
    """Points (m, 3) at the place of the input; InputError where doubles cannot hold them."""
    with np.errstate(over="ignore"):
        found: Floats = points + shift
    if not np.isfinite(found).all():
        raise InputError("the stream is damaged (its shift)")
    return found

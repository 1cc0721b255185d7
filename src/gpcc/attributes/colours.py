"""Conversion of attribute values between applications and the coder, as in TMC13."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpcc.syntax import Three

Values = NDArray[np.int32]

IDENTITY, BT709, YCGCO = 0, 1, 8
"""Values of matrix_coefficients (ISO/IEC 23091-2): none, ITU-R BT.709, and reversible YCgCo."""

_MOST = 255.0
_HALF = 128.0


def coded_colours(colours: Values, matrix: int | None, bitdepth: int) -> Values:
    """Return red, green and blue (n, 3), converted to the components (n, 3) that are coded.

    Parameters
    ----------
    colours
        Red, green and blue (n, 3).
    matrix
        Colour space of the result: `BT709` or `YCGCO`. With any other value, the components are
        green, blue and red.
    bitdepth
        Number of bits of a value.
    """
    red, green, blue = colours.T
    if matrix == BT709:
        r, g, b = (channel.astype(np.float64) for channel in (red, green, blue))
        return _stacked(
            _rounded(0.212600 * r + 0.715200 * g + 0.072200 * b),
            _rounded(-0.114572 * r - 0.385428 * g + 0.5 * b + _HALF),
            _rounded(0.5 * r - 0.454153 * g - 0.045847 * b + _HALF),
        )
    if matrix == YCGCO:
        offset = 1 << bitdepth - 1
        orange = red - blue
        middle = blue + (orange >> 1)
        greenness = green - middle
        return _stacked(middle + (greenness >> 1), greenness + offset, orange + offset)
    return _stacked(green, blue, red)


def decoded_colours(values: Values, matrix: int | None, bitdepth: int) -> Values:
    first, second, third = values.T
    if matrix == BT709:
        y, u, v = first.astype(np.float64), second - _HALF, third - _HALF
        return _stacked(
            _rounded(y + 1.57480 * v),
            _rounded(y - 0.18733 * u - 0.46813 * v),
            _rounded(y + 1.85563 * u),
        )
    if matrix == YCGCO:
        offset, most = 1 << bitdepth - 1, (1 << bitdepth - 1) - 1
        greenness, orange = second - offset, third - offset
        middle = first - (greenness >> 1)
        blue = middle - (orange >> 1)
        converted: Values = np.clip(_stacked(orange + blue, greenness + middle, blue), 0, most)
        return converted
    return _stacked(third, first, second)


def _stacked(*channels: NDArray[np.int32] | NDArray[np.float64]) -> Values:
    return np.stack([channel.astype(np.int32) for channel in channels], axis=1)


def _rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    values = values + np.copysign(np.nextafter(0.5, 0), values)
    rounded: NDArray[np.float64] = np.clip(np.trunc(values), 0.0, _MOST)
    return rounded


def coded_values(values: Values, scaling: Three) -> Values:
    """Return reflectances (n, 1) minus the offset, divided by the scale, as they are coded."""
    scale_minus1, frac_bits, offset = scaling
    shifted = (values.astype(np.int64) - offset) << frac_bits
    quotient = np.abs(shifted) // (scale_minus1 + 1) * np.sign(shifted)
    coded: Values = (quotient & 0xFFFF).astype(np.int32)
    return coded


def decoded_values(values: Values, scaling: Three) -> Values:
    """Return decoded reflectances, multiplied by the scale, plus the offset, as 16-bit numbers."""
    scale_minus1, frac_bits, offset = scaling
    scaled = (values.astype(np.int64) * (scale_minus1 + 1) >> frac_bits) + offset
    return (scaled & 0xFFFF).astype(np.int32)

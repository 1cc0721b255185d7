"""Integer spherical coordinates of a point: radius, azimuth and index of the laser.

Angular coding predicts in these coordinates, and converts them to x, y, z by fixed-point sines.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gpcc.compiled import integer, kernel
from gpcc.fixed_point import int32
from gpcc.syntax import GeometryParameterSet, Three
from pointkit.coding.intrinsics import leading_zeros
from pointkit.compiling import inlined
from pointkit.errors import InputError
from pointkit.geometry.morton import Ints

_SINE_LOG2 = 24
_SINE_STEPS_LOG2 = 12  # steps per turn
_SINES: Ints = np.rint(
    (1 << _SINE_LOG2) * np.sin(np.arange(1026) * (2 * np.pi / (1 << _SINE_STEPS_LOG2)))
).astype(np.int64)
_THETA_LOG2, _Z_LOG2 = 20, 3
_MOST_AZIMUTH_LOG2, _MOST_RADIUS_LOG2 = 30, 30


class Sphere(NamedTuple):
    """Parameters of the spherical coordinates of a slice: the sensor, and the steps."""

    # Log2 of the coding units per radius step.
    radius_log2: int
    # Log2 of the azimuth steps per turn.
    azimuth_log2: int
    # theta, z: elevations and heights of the lasers, see `syntax.Laser`.
    theta: Ints
    z: Ints
    # Sensor's position relative to the slice's origin, along the coded axes.
    origin: Three


def sphere(gps: GeometryParameterSet, origin: Three) -> Sphere:
    """Return the parameters of the spherical coordinates of a slice.

    Raises InputError if the steps are not supported.
    """
    azimuth_log2 = gps.geom_angular_azimuth_scale_log2_minus11 + 12
    radius_log2 = gps.geom_angular_radius_inv_scale_log2
    if azimuth_log2 > _MOST_AZIMUTH_LOG2 or radius_log2 > _MOST_RADIUS_LOG2:
        raise InputError("G-PCC stream: its steps of the azimuth or the radius are not supported")
    theta = np.array([laser.theta for laser in gps.lasers], dtype=np.int64)
    heights = np.array([laser.z for laser in gps.lasers], dtype=np.int64)
    return Sphere(radius_log2, azimuth_log2, theta, heights, origin)


@inlined
def halved_away(value: int, shift: int) -> int:
    half = (1 << shift) >> 1
    return (value + half) >> shift if value >= 0 else -((half - value) >> shift)


@kernel
def sine(azimuth: int, azimuth_log2: int) -> int:
    """Return the sine of an azimuth, in units of 2^-24, interpolated from a table.

    Azimuths beyond half a turn are clamped. A turn has 2^`azimuth_log2` azimuth steps.
    """
    half = 1 << (azimuth_log2 - 1)
    within = min(abs(azimuth), half)
    if within > half >> 1:
        within = half - within
    value = _quarter_sine(within, azimuth_log2)
    return value if azimuth >= 0 else -value


@kernel
def cosine(azimuth: int, azimuth_log2: int) -> int:
    half = 1 << (azimuth_log2 - 1)
    within = min(abs(azimuth), half)
    quarter = half >> 1
    if within <= quarter:
        return _quarter_sine(quarter - within, azimuth_log2)
    return -_quarter_sine(within - quarter, azimuth_log2)


@kernel
def _quarter_sine(azimuth: int, azimuth_log2: int) -> int:
    shift = azimuth_log2 - _SINE_STEPS_LOG2
    index = azimuth >> shift
    rest = azimuth - (index << shift)
    rise = rest * (_SINES[index + 1] - _SINES[index])
    return integer(_SINES[index] + ((rise + ((1 << shift) >> 1)) >> shift))


@inlined
def cartesian(around: Sphere, radius: int, azimuth: int, laser: int) -> Three:
    """Return x, y and z, relative to the sensor, of radius, azimuth and laser index.

    The steps of radius and azimuth are those of `around`.
    """
    r = int32(radius << around.radius_log2)
    height = halved_away((around.theta[laser] * r) << 2, _THETA_LOG2 - _Z_LOG2)
    return (
        int32(halved_away(r * cosine(azimuth, around.azimuth_log2), _SINE_LOG2)),
        int32(halved_away(r * sine(azimuth, around.azimuth_log2), _SINE_LOG2)),
        int32(halved_away(height - around.z[laser], _Z_LOG2)),
    )


@kernel
def azimuth_of_arc(arc: int, radius: int, azimuth_log2: int) -> int:
    """Return an arc, in units of 1 / (8 `radius`) turns, converted to azimuth steps.

    As in TMC13, the reciprocal of the scaled radius b is approximated by 48/17 - 32/17 b and one
    step of Newton's method.
    """
    r = int32(radius << 3)
    if r == 0:
        r = 1
    length = 64 - leading_zeros(r)
    b = r << (31 - length) if length <= 31 else r >> (length - 31)
    inverse = ((0x2D2D2D2D << 31) - 0x1E1E1E1E * b) >> 28
    inverse += (inverse * ((1 << 31) - ((b * inverse) >> 31))) >> 31
    shift = (31 + length - azimuth_log2) & 63  # modulo 64, as processors shift
    product = arc * inverse
    return int32(product >> shift if product >= 0 else -((-product) >> shift))


@kernel
def spherical(around: Sphere, x: int, y: int, z: int) -> Three:
    """Return the radius, azimuth and laser that `cartesian` maps nearest to (x, y, z)."""
    distance = _rounded(math.hypot(x, y))
    laser = _nearest_laser(around, distance, z)
    turn = math.atan2(y, x) / (2.0 * math.pi) * (1 << around.azimuth_log2)
    radius = (distance + ((1 << around.radius_log2) >> 1)) >> around.radius_log2
    azimuth = _rounded(turn)
    least = _off(around, radius, azimuth, laser, x, y, z)
    best = 0, 0
    for turned in range(-2, 3):
        if least == 0:
            break
        for farther in range(-2, 3):
            if radius + farther < 0:
                continue
            off = _off(around, radius + farther, azimuth + turned, laser, x, y, z)
            if off < least:
                least, best = off, (farther, turned)
    return radius + best[0], azimuth + best[1], laser


@kernel
def _nearest_laser(around: Sphere, distance: int, z: int) -> int:
    laser, least = 0, (1 << 31) - 1
    for k in range(len(around.theta)):
        height = halved_away((around.theta[k] * distance) << 2, _THETA_LOG2 - _Z_LOG2)
        off = abs(halved_away(height - around.z[k], _Z_LOG2) - z)
        if off < least:
            laser, least = k, off
    return laser


@kernel
def _off(around: Sphere, radius: int, azimuth: int, laser: int, x: int, y: int, z: int) -> int:
    a, b, c = cartesian(around, radius, azimuth, laser)
    return abs(a - x) + abs(b - y) + abs(c - z)


@inlined
def _rounded(value: float) -> int:
    whole = math.floor(abs(value))
    if abs(value) - whole >= 0.5:
        whole += 1
    return -integer(whole) if value < 0 else integer(whole)

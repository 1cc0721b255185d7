"""Integer square roots and arc tangent, equal to TMC13's `irsqrt`, `isqrt` and `iatan2`.

Angles are in units of 2^-20 radians.
"""

from __future__ import annotations

import numpy as np

from gpcc.compiled import kernel
from pointkit.coding.intrinsics import leading_zeros
from pointkit.compiling import inlined

HALF_TURN = 3294199
TURN = 6588397
_QUARTER_TURN = 1647099

# First approximation of 1 / sqrt(a), indexed by the first seven bits of a, and its cube in units of
# 2^-14. No formula reproduces these constants of the standard exactly.
_ROOTS = np.array(
    [
        *(254, 250, 247, 243, 240, 236, 233, 230, 228, 225, 222, 220, 217, 215, 212, 210),
        *(208, 206, 204, 202, 200, 198, 196, 194, 193, 191, 189, 188, 186, 185, 183, 182),
        *(180, 179, 178, 176, 175, 174, 172, 171, 170, 169, 168, 167, 166, 165, 163, 162),
        *(161, 160, 159, 159, 158, 156, 156, 155, 154, 153, 152, 151, 151, 150, 149, 148),
        *(147, 147, 146, 145, 144, 144, 143, 142, 142, 141, 140, 140, 139, 138, 138, 137),
        *(137, 136, 135, 135, 134, 134, 133, 132, 132, 131, 131, 130, 130, 129, 129, 128),
    ],
    dtype=np.int64,
)
_CUBES = np.array(
    [
        *(4096759, 3906237, 3767294, 3587230, 3455997, 3286059, 3162329, 3041734),
        *(2963083, 2847647, 2735276, 2661993, 2554581, 2484593, 2382017, 2315252),
        *(2249735, 2185462, 2122417, 2060607, 2000008, 1940591, 1882386, 1825342),
        *(1797258, 1741976, 1687814, 1661157, 1608703, 1582894, 1532127, 1507135),
        *(1458001, 1433825, 1409924, 1362946, 1339851, 1316998, 1272096, 1250059),
        *(1228258, 1206690, 1185412, 1164350, 1143563, 1123027, 1082689, 1062871),
        *(1043313, 1023992, 1004914, 1004918, 986064, 949110, 949104, 930976),
        *(913080, 895408, 877941, 860732, 860735, 843759, 826999, 810450),
        *(794124, 794142, 778048, 762167, 746497, 746501, 731056, 715816),
        *(715837, 700805, 686004, 686002, 671407, 657018, 657019, 642831),
        *(642829, 628855, 615092, 615100, 601540, 601516, 588161, 574980),
        *(575004, 562024, 562038, 549251, 549257, 536676, 536684, 524293),
    ],
    dtype=np.int64,
)
_ROOTS_3 = _ROOTS * (3 << 22)
_ROOTS_CUBED = _CUBES << 10
_ARC_SINES = np.rint(np.arcsin(np.minimum(np.arange(364), 362) / 512) * 2**20).astype(np.int64)


@inlined
def int32(number: int) -> int:
    """Return a number wrapped to a signed 32-bit integer, as in TMC13."""
    return ((number & 0xFFFFFFFF) ^ 0x80000000) - 0x80000000


@inlined
def inverse_square_root(number: int) -> int:
    """Return 2^40 / sqrt(number) for a number below 2^63, or 0 for 0."""
    if number <= 0:
        return 0
    pairs: int = 16 - (
        65 - leading_zeros(number) >> 1
    )  # pairs of bits that normalise to 31 or 32 bits
    number = number << 2 * pairs if pairs >= 0 else number >> -2 * pairs
    shift = pairs - 3
    index = (number >> 25) - 32
    root: int = _ROOTS_3[index] - (_ROOTS_CUBED[index] * number >> 32)
    error = 0x30000000 - (root * (root * number >> 32) >> 32)
    root = root * error >> 32
    return root << shift if shift > 0 else root >> -shift


@kernel
def square_root(number: int) -> int:
    """Return the square root of a number below 2^62; up to 2^46 the error is at most 2."""
    if number <= 1 << 46:
        return 1 + ((number * inverse_square_root(number) >> 40) & 0xFFFFFF)
    number = (number + 65536) >> 16
    return 1 + (number * inverse_square_root(number) >> 32)


@inlined
def _arc_tangent(y: int, x: int) -> int:
    sine = y * inverse_square_root(x * x + y * y) >> 20
    index = sine >> 11
    rest = sine & 0x7FF
    below: int = _ARC_SINES[index]
    above: int = _ARC_SINES[index + 1]
    return below + (rest * (above - below) >> 11)


@kernel
def arc_tangent(y: int, x: int) -> int:
    """Return the angle of (x, y) in (-pi, pi], or 0 at the origin; |x| and |y| are below 2^30."""
    x_size, y_size = abs(x), abs(y)
    angle = _arc_tangent(min(x_size, y_size), max(x_size, y_size))
    if y_size > x_size:
        angle = _QUARTER_TURN - angle
    if x < 0:
        angle = HALF_TURN - angle
    return -angle if y < 0 else angle

"""Least-squares planes through points, computed from weighted moments of the points.

Ten moments describe a set of points: the weight, three first moments, and six second moments (xx,
xy, xz, yy, yz, zz). A plane (nx, ny, nz, d) contains the points p with n.p = d, where |n| = 1.
"""

from __future__ import annotations

import numpy as np

from pointkit.compiling import compiled_in_place, inlined
from pointkit.geometry.cloud import Floats

MOMENT_COUNT = 10


@compiled_in_place
def add_point(moments: Floats, x: float, y: float, z: float, weight: float) -> None:
    """Add a weighted point to the ten moments."""
    moments[0] += weight
    moments[1] += weight * x
    moments[2] += weight * y
    moments[3] += weight * z
    moments[4] += weight * x * x
    moments[5] += weight * x * y
    moments[6] += weight * x * z
    moments[7] += weight * y * y
    moments[8] += weight * y * z
    moments[9] += weight * z * z


@compiled_in_place
def squared_distance(moments: Floats, plane: Floats) -> float:
    """Return the weighted sum of squared distances of the points from a plane (4,)."""
    a, b, c, d = plane[0], plane[1], plane[2], plane[3]
    along = a * a * moments[4] + b * b * moments[7] + c * c * moments[9]
    along += 2 * (a * b * moments[5] + a * c * moments[6] + b * c * moments[8])
    along -= 2 * d * (a * moments[1] + b * moments[2] + c * moments[3])
    return float(max(along + d * d * moments[0], 0.0))


@compiled_in_place
def fit_plane(moments: Floats, plane: Floats) -> float:
    """Fit the plane with the least weighted sum of squared distances from the points.

    The plane (4,) is written to `plane`, and the sum is returned.
    """
    w = moments[0]
    x, y, z = moments[1] / w, moments[2] / w, moments[3] / w
    xx, xy, xz, yy, yz, zz = _covariance(moments)
    least = _least_eigenvalue(xx, xy, xz, yy, yz, zz)
    _null_vector(xx - least, xy, xz, yy - least, yz, zz - least, plane)
    plane[3] = plane[0] * x + plane[1] * y + plane[2] * z
    return float(max(least, 0.0) * w)


@compiled_in_place
def distance_to_fit(moments: Floats) -> float:
    """Return the weighted sum of squared distances of the points from their best plane."""
    xx, xy, xz, yy, yz, zz = _covariance(moments)
    return float(max(_least_eigenvalue(xx, xy, xz, yy, yz, zz), 0.0) * moments[0])


@inlined
def _covariance(moments: Floats) -> tuple[float, float, float, float, float, float]:
    w = moments[0]
    x, y, z = moments[1] / w, moments[2] / w, moments[3] / w
    xx, xy, xz = moments[4] / w - x * x, moments[5] / w - x * y, moments[6] / w - x * z
    yy, yz, zz = moments[7] / w - y * y, moments[8] / w - y * z, moments[9] / w - z * z
    return xx, xy, xz, yy, yz, zz


@inlined
def _least_eigenvalue(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float) -> float:
    """Return the smallest eigenvalue of a symmetric 3x3 matrix (closed form of Smith 1961)."""
    q = (xx + yy + zz) / 3
    off = xy * xy + xz * xz + yz * yz
    p = np.sqrt(((xx - q) ** 2 + (yy - q) ** 2 + (zz - q) ** 2 + 2 * off) / 6)
    if p < 1e-12:
        return float(q)
    a, b, c = (xx - q) / p, (yy - q) / p, (zz - q) / p
    d, e, f = xy / p, xz / p, yz / p
    half = (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)) / 2
    angle = np.arccos(min(max(half, -1.0), 1.0)) / 3
    return float(q + 2 * p * np.cos(angle + 2 * np.pi / 3))


@inlined
def _null_vector(
    xx: float, xy: float, xz: float, yy: float, yz: float, zz: float, out: Floats
) -> None:
    """Write the unit null vector of a singular symmetric 3x3 matrix.

    The vector is the longest cross product of two rows.
    """
    best = 0.0
    out[0], out[1], out[2] = 0.0, 0.0, 1.0
    x, y, z = (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)
    for (a, b, c), (d, e, f) in ((x, y), (x, z), (y, z)):
        u, v, w = b * f - c * e, c * d - a * f, a * e - b * d
        length = u * u + v * v + w * w
        if length > best:
            best = length
            root = np.sqrt(length)
            out[0], out[1], out[2] = u / root, v / root, w / root

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats, PointCloud, check_points
from puckbench.geometry.neighbours import Neighbours, SearchablePoints
from puckbench.metrics.psnr import psnr

_YUV = np.array(
    [
        [0.2126, 0.7152, 0.0722],
        [-0.1146, -0.3854, 0.5],
        [0.5, -0.4542, -0.0458],
    ]
)
"""BT.709, full range, as in MPEG's pc_error."""
_CHANNELS = ("y", "u", "v")
GEOMETRY_WEIGHT = 0.6597
"""Weight of geometry against luma in the joint metric (Viola, Subramanyam and Cesar 2020)."""
_BINS = 256


def yuv(colours: np.ndarray) -> Floats:
    """Convert uint8 RGB (n, 3) to YUV (n, 3): Y in [0, 1], U and V in [-0.5, 0.5]."""
    return np.asarray(np.asarray(colours, dtype=np.float64) @ _YUV.T / 255)


def colour_distortion(reference: PointCloud, decoded: PointCloud) -> dict[str, float]:
    """Return the colour errors between nearest neighbours, the larger of both directions.

    The colours of points with equal coordinates, and of equidistant neighbours, are averaged.

    Returns
    -------
    dict
        ``y_mse``, ``u_mse``, ``v_mse``; ``y_psnr``, ``u_psnr``, ``v_psnr`` (dB, peak 1);
        ``luminance_l2`` (`luminance_distance`).
    """
    a, a_colours = _merged(reference, "reference cloud")
    b, b_colours = _merged(decoded, "decoded cloud")
    a_points, b_points = SearchablePoints(a), SearchablePoints(b)
    ab = _squared(a_colours, b_colours, b_points.nearest(a_points))
    ba = _squared(b_colours, a_colours, a_points.nearest(b_points))
    errors = np.maximum(ab, ba)
    values = {f"{name}_mse": float(errors[i]) for i, name in enumerate(_CHANNELS)}
    values |= {f"{name}_psnr": psnr(values[f"{name}_mse"], 1.0) for name in _CHANNELS}
    return values | {"luminance_l2": luminance_distance(a_colours[:, 0], b_colours[:, 0])}


def luminance_distance(a: Floats, b: Floats) -> float:
    """Return the distance between the normalised luma histograms (256 bins) of two clouds.

    `a` and `b` are luma values, (n,) and (m,).
    """
    shares = [np.histogram(y, _BINS, (0.0, 1.0))[0] / len(y) for y in (a, b)]
    return float(np.linalg.norm(shares[0] - shares[1]))


def joint_quality(distortion: Mapping[str, float], colour: Mapping[str, float]) -> float:
    """Return PCC Arena's joint metric of geometry (``cd_plane``) and colour (``luminance_l2``).

    Lower is better (Viola, Subramanyam and Cesar 2020).
    """
    if "cd_plane" not in distortion:
        return math.nan
    weighted = GEOMETRY_WEIGHT * distortion["cd_plane"]
    return weighted + (1 - GEOMETRY_WEIGHT) * colour["luminance_l2"]


def _merged(cloud: PointCloud, what: str) -> tuple[Floats, Floats]:
    check_points(cloud.xyz, what)
    if cloud.colours is None or cloud.colours.shape != cloud.xyz.shape:
        raise InputError(f"{what}: needs a colour for every point")
    points, inverse = np.unique(cloud.xyz, axis=0, return_inverse=True)
    values, inverse = yuv(cloud.colours), inverse.ravel()
    sums = np.stack([np.bincount(inverse, values[:, i]) for i in range(3)], axis=1)
    return points, sums / np.bincount(inverse)[:, None]


def _squared(queries: Floats, colours: Floats, nearest: Neighbours) -> Floats:
    return np.asarray(np.mean((queries - _means(colours, nearest)) ** 2, axis=0))


def _means(colours: Floats, nearest: Neighbours) -> Floats:
    sums = np.add.reduceat(colours[nearest.index], nearest.starts[:-1], axis=0)
    return np.asarray(sums / np.diff(nearest.starts)[:, None])

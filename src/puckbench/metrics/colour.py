"""Distortion of colours: PSNR of luminance and chrominance, and a joint measure of quality."""

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
"""BT.709, full range, as MPEG's pc_error has it."""
_CHANNELS = ("y", "u", "v")
GEOMETRY_WEIGHT = 0.6597
"""Weight of geometry against luminance in the joint measure (Viola, Subramanyam, Cesar 2020)."""
_BINS = 256


def yuv(colours: np.ndarray) -> Floats:
    """Y in [0, 1], U and V in [-0.5, 0.5], (n, 3), of uint8 RGB (n, 3)."""
    return np.asarray(np.asarray(colours, dtype=np.float64) @ _YUV.T / 255)


def colour_distortion(reference: PointCloud, decoded: PointCloud) -> dict[str, float]:
    """Colour errors between nearest neighbours, in both directions.

    Points with equal coordinates are merged first, their colours averaged; of several nearest
    neighbours the mean colour counts.

    Parameters
    ----------
    reference, decoded
        Clouds with colours.

    Returns
    -------
    dict
        For each of y, u and v, ``y_mse`` (larger of both directions, of channels one unit wide) and
        ``y_psnr`` (dB, peak 1, infinite without error); and ``luminance_l2``, see
        `luminance_distance`.

    Raises
    ------
    InputError
        A cloud has no colours.
    """
    a, a_colours = _merged(reference, "reference cloud")
    b, b_colours = _merged(decoded, "decoded cloud")
    a_points, b_points = SearchablePoints(a), SearchablePoints(b)
    forth = _squared(a_colours, b_colours, b_points.nearest(a_points))
    back = _squared(b_colours, a_colours, a_points.nearest(b_points))
    errors = np.maximum(forth, back)
    values = {f"{name}_mse": float(errors[i]) for i, name in enumerate(_CHANNELS)}
    values |= {f"{name}_psnr": psnr(values[f"{name}_mse"], 1.0) for name in _CHANNELS}
    return values | {"luminance_l2": luminance_distance(a_colours[:, 0], b_colours[:, 0])}


def luminance_distance(a: Floats, b: Floats) -> float:
    """Euclidean distance of the luminance histograms, shares in 256 bins, of two clouds' Y."""
    shares = [np.histogram(y, _BINS, (0.0, 1.0))[0] / len(y) for y in (a, b)]
    return float(np.linalg.norm(shares[0] - shares[1]))


def joint_quality(distortion: Mapping[str, float], colour: Mapping[str, float]) -> float:
    """Joint measure of geometry and colour, ``cd_plane`` and ``luminance_l2``; lower is better.

    PCC Arena's form of the measure of Viola et al. Chamfer distances are squared units of the
    cloud, so it compares codecs on one cloud and not across scales. (PCC Arena's own colour term
    is always 0, by an integer division.)

    References
    ----------
    Viola, Subramanyam and Cesar 2020, "A color-based objective quality metric for point cloud
    contents".
    """
    if "cd_plane" not in distortion:
        return math.nan
    weighted = GEOMETRY_WEIGHT * distortion["cd_plane"]
    return weighted + (1 - GEOMETRY_WEIGHT) * colour["luminance_l2"]


def _merged(cloud: PointCloud, what: str) -> tuple[Floats, Floats]:
    """Distinct points (k, 3) and the mean YUV (k, 3) of each."""
    check_points(cloud.xyz, what)
    if cloud.colours is None or cloud.colours.shape != cloud.xyz.shape:
        raise InputError(f"{what}: no colour for every point")
    points, inverse = np.unique(cloud.xyz, axis=0, return_inverse=True)
    values, inverse = yuv(cloud.colours), inverse.ravel()
    sums = np.stack([np.bincount(inverse, values[:, i]) for i in range(3)], axis=1)
    return points, sums / np.bincount(inverse)[:, None]


def _squared(queries: Floats, colours: Floats, nearest: Neighbours) -> Floats:
    """Mean squared error (3,) of the queries' colours against their neighbours'."""
    return np.asarray(np.mean((queries - _means(colours, nearest)) ** 2, axis=0))


def _means(colours: Floats, nearest: Neighbours) -> Floats:
    """Mean colour (m, 3) of each query's neighbours."""
    sums = np.add.reduceat(colours[nearest.index], nearest.starts[:-1], axis=0)
    return np.asarray(sums / np.diff(nearest.starts)[:, None])

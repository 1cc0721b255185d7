from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.metrics.paired_values import distinct_values, pair_errors, same_values
from puckbench.metrics.psnr import psnr

_YUV = np.array(
    [
        [0.2126, 0.7152, 0.0722],
        [-0.1146, -0.3854, 0.5],
        [0.5, -0.4542, -0.0458],
    ]
)
"""Matrix from RGB to YUV: BT.709, full range, as in MPEG's pc_error."""
_CHANNELS = ("y", "u", "v")
GEOMETRY_WEIGHT = 0.6597
"""Weight of geometry in the joint metric; luma has the remaining weight (Viola et al. 2020)."""
_BINS = 256


def yuv(colours: np.ndarray) -> Floats:
    """Convert RGB colours (n, 3) of type uint8 to YUV (n, 3) by the matrix of BT.709.

    Y is in [0, 1]; U and V are in [-0.5, 0.5].
    """
    return np.asarray(np.asarray(colours, dtype=np.float64) @ _YUV.T / 255)


def colour_distortion(reference: PointCloud, decoded: PointCloud) -> dict[str, float]:
    """Return the errors of the decoded colours.

    A point's colour is compared with that of the nearest point in the other cloud, in both
    directions (see `paired_values`). The larger error of both directions is returned.

    Returns
    -------
    dict
        * ``y_mse``, ``u_mse``, ``v_mse``: mean squared errors, of values from 0 to 1 (Y).
        * ``y_psnr``, ``u_psnr``, ``v_psnr``: PSNRs in dB, with peak 1.
        * ``colour_max_error``: largest difference of an RGB component (0 to 255).
        * ``colour_lossless``: whether both clouds have the same colours.
        * ``luminance_l2``: difference of the luma histograms (see `luminance_distance`).

    Raises
    ------
    InputError
        A cloud has no colours or no points.
    """
    a_colours, b_colours = (
        _colours(reference, "reference cloud"),
        _colours(decoded, "decoded cloud"),
    )
    a = distinct_values(reference.xyz, np.hstack([yuv(a_colours), a_colours]), "reference cloud")
    b = distinct_values(decoded.xyz, np.hstack([yuv(b_colours), b_colours]), "decoded cloud")
    squared, largest = pair_errors(a, b)
    values = {f"{name}_mse": float(squared[i]) for i, name in enumerate(_CHANNELS)}
    values |= {f"{name}_psnr": psnr(values[f"{name}_mse"], 1.0) for name in _CHANNELS}
    values["colour_max_error"] = float(largest[3:].max())
    values["colour_lossless"] = same_values(a_colours, b_colours)
    return values | {"luminance_l2": luminance_distance(a.values[:, 0], b.values[:, 0])}


def luminance_distance(a: Floats, b: Floats) -> float:
    """Return how much the luma histograms of two clouds differ.

    Parameters
    ----------
    a, b
        Lumas (n,) and (m,) from 0 to 1.

    Returns
    -------
    float
        Euclidean distance of both histograms, each with 256 bins and the sum 1.
    """
    shares = [np.histogram(y, _BINS, (0.0, 1.0))[0] / len(y) for y in (a, b)]
    return float(np.linalg.norm(shares[0] - shares[1]))


def joint_quality(distortion: Mapping[str, float], colour: Mapping[str, float]) -> float:
    """Return PCC Arena's joint error of geometry and colour, where lower is better.

    It is the weighted sum of ``cd_plane`` and ``luminance_l2`` (Viola, Subramanyam and Cesar 2020).

    Parameters
    ----------
    distortion
        Result of `puckbench.metrics.geometry.distortion`.
    colour
        Result of `colour_distortion`.

    Returns
    -------
    float
        The joint error, or nan if `distortion` lacks ``cd_plane`` (the original has no normals).
    """
    if "cd_plane" not in distortion:
        return math.nan
    weighted = GEOMETRY_WEIGHT * distortion["cd_plane"]
    return weighted + (1 - GEOMETRY_WEIGHT) * colour["luminance_l2"]


def _colours(cloud: PointCloud, source: str) -> np.ndarray:
    if cloud.colours is None:
        raise InputError(f"{source}: needs a colour for every point")
    return cloud.colours

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
"""Weight of geometry against luma in the joint metric (Viola et al. 2020)."""
_BINS = 256


def yuv(colours: np.ndarray) -> Floats:
    """Convert uint8 RGB (n, 3) to YUV (n, 3): Y in [0, 1], U and V in [-0.5, 0.5]."""
    return np.asarray(np.asarray(colours, dtype=np.float64) @ _YUV.T / 255)


def colour_distortion(reference: PointCloud, decoded: PointCloud) -> dict[str, float]:
    """Return the colour errors between nearest neighbours (see `paired_values`).

    Returns
    -------
    dict
        ``y_mse``, ``u_mse``, ``v_mse``; ``y_psnr``, ``u_psnr``, ``v_psnr`` (dB, peak 1);
        ``colour_max_error``, the largest difference of an RGB component (0 to 255);
        ``colour_lossless``; ``luminance_l2`` (see `luminance_distance`).
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
    """Return the Euclidean distance of normalised 256-bin histograms of lumas (n,) and (m,)."""
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


def _colours(cloud: PointCloud, source: str) -> np.ndarray:
    if cloud.colours is None:
        raise InputError(f"{source}: needs a colour for every point")
    return cloud.colours

"""Peak signal-to-noise ratios of distortions; the peak is always given, never assumed."""

from __future__ import annotations

import math
from collections.abc import Mapping

PEAK_M = 30.0
"""Peak of clouds in metres unless another is chosen: 30,000 steps of 1 mm, as in MPEG's test
conditions. Papers on KITTI take 59.70 m."""


def psnr(mse: float, peak: float, factor: float = 1.0) -> float:
    """``10 log10(factor * peak^2 / mse)`` in dB, infinite where there is no error.

    Minus infinity for a peak of 0, the diameter of points that are all the same.
    """
    if mse == 0:
        return math.inf
    return 10 * math.log10(factor * peak**2 / mse) if peak else -math.inf


def cd_psnr(values: Mapping[str, float], diameter: float) -> dict[str, float]:
    """PCC Arena's PSNR of the Chamfer distances, whose peak is the diameter of the reference.

    Parameters
    ----------
    values
        Of `puckbench.metrics.geometry.distortion`.
    diameter
        Of the reference cloud, in its unit.

    Returns
    -------
    dict
        ``cd_psnr_point`` and, where measured, ``cd_psnr_plane``, in dB.
    """
    kinds = [kind for kind in ("point", "plane") if f"cd_{kind}" in values]
    return {f"cd_psnr_{kind}": psnr(values[f"cd_{kind}"], diameter) for kind in kinds}


def mpeg_psnr(values: Mapping[str, float], peak: float) -> dict[str, float]:
    """MPEG's D1 and D2 PSNR, as pc_error computes them (with a factor of 3 for both).

    Parameters
    ----------
    values
        Of `puckbench.metrics.geometry.distortion`.
    peak
        The largest coordinate, 1023 for clouds of 10 bits.

    Returns
    -------
    dict
        ``d1_psnr`` and, where measured, ``d2_psnr``, in dB.
    """
    kinds = [kind for kind in ("d1", "d2") if f"{kind}_mse" in values]
    return {f"{kind}_psnr": psnr(values[f"{kind}_mse"], peak, factor=3) for kind in kinds}

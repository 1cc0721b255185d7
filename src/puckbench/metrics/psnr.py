from __future__ import annotations

import math
from collections.abc import Mapping


def psnr(mse: float, peak: float, factor: float = 1.0) -> float:
    """Return the peak signal-to-noise ratio ``10 log10(factor * peak^2 / mse)`` in dB.

    Parameters
    ----------
    mse
        Mean squared error.
    peak
        Largest possible signal, in the unit whose square is that of `mse`.
    factor
        Factor of the squared peak.

    Returns
    -------
    float
        The PSNR: infinity if `mse` is 0, minus infinity if only `peak` is 0.
    """
    if mse == 0:
        return math.inf
    return 10 * math.log10(factor * peak**2 / mse) if peak else -math.inf


def cd_psnr(values: Mapping[str, float], diameter: float) -> dict[str, float]:
    """Return PCC Arena's PSNRs of the Chamfer distances.

    Parameters
    ----------
    values
        Result of `puckbench.metrics.geometry.distortion`.
    diameter
        Largest distance between points of the original, which is the peak.

    Returns
    -------
    dict
        ``cd_psnr_point`` and, if there are point-to-plane errors, ``cd_psnr_plane``, in dB.
    """
    kinds = [kind for kind in ("point", "plane") if f"cd_{kind}" in values]
    return {f"cd_psnr_{kind}": psnr(values[f"cd_{kind}"], diameter) for kind in kinds}


def mpeg_psnr(values: Mapping[str, float], peak: float) -> dict[str, float]:
    """Return MPEG's PSNRs of D1 and D2, with the factor 3 that pc_error uses.

    Parameters
    ----------
    values
        Result of `puckbench.metrics.geometry.distortion`.
    peak
        Peak in units of the cloud.

    Returns
    -------
    dict
        ``d1_psnr`` and, if there are point-to-plane errors, ``d2_psnr``, in dB.
    """
    kinds = [kind for kind in ("d1", "d2") if f"{kind}_mse" in values]
    return {f"{kind}_psnr": psnr(values[f"{kind}_mse"], peak, factor=3) for kind in kinds}

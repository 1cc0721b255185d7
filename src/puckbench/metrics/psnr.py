"""Peak signal-to-noise ratios of distortions; the peak is always given, never assumed."""

from __future__ import annotations

import math
from collections.abc import Mapping


def psnr(mse: float, peak: float, factor: float = 1.0) -> float:
    """Return ``10 log10(factor * peak^2 / mse)`` in dB; infinite where there is no error."""
    return math.inf if mse == 0 else 10 * math.log10(factor * peak**2 / mse)


def cd_psnr(values: Mapping[str, float], diameter: float) -> dict[str, float]:
    """``cd_psnr_point`` and, where measured, ``cd_psnr_plane`` in dB, as PCC Arena has them.

    `values` are those of `puckbench.metrics.geometry.distortion`; the peak is the `diameter` of
    the reference cloud, in its units.
    """
    kinds = [kind for kind in ("point", "plane") if f"cd_{kind}" in values]
    return {f"cd_psnr_{kind}": psnr(values[f"cd_{kind}"], diameter) for kind in kinds}


def mpeg_psnr(values: Mapping[str, float], peak: float) -> dict[str, float]:
    """``d1_psnr`` and, where measured, ``d2_psnr`` in dB, as MPEG's pc_error has them.

    The factor is 3 for both; `peak` is the largest coordinate, 1023 for clouds of 10 bits.
    """
    kinds = [kind for kind in ("d1", "d2") if f"{kind}_mse" in values]
    return {f"{kind}_psnr": psnr(values[f"{kind}_mse"], peak, factor=3) for kind in kinds}

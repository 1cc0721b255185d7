from __future__ import annotations

import math
from collections.abc import Mapping


def psnr(mse: float, peak: float, factor: float = 1.0) -> float:
    """Return ``10 log10(factor * peak^2 / mse)`` in dB; infinity if `mse` is 0."""
    if mse == 0:
        return math.inf
    return 10 * math.log10(factor * peak**2 / mse) if peak else -math.inf


def cd_psnr(values: Mapping[str, float], diameter: float) -> dict[str, float]:
    """Return PCC Arena's PSNRs of Chamfer distances in dB, ``cd_psnr_point`` and ``cd_psnr_plane``.

    `values` are results of `distortion`; the peak is the reference's `diameter`.
    """
    kinds = [kind for kind in ("point", "plane") if f"cd_{kind}" in values]
    return {f"cd_psnr_{kind}": psnr(values[f"cd_{kind}"], diameter) for kind in kinds}


def mpeg_psnr(values: Mapping[str, float], peak: float) -> dict[str, float]:
    """Return MPEG's PSNRs in dB, ``d1_psnr`` and ``d2_psnr``, with pc_error's factor of 3.

    `values` are results of `distortion`.
    """
    kinds = [kind for kind in ("d1", "d2") if f"{kind}_mse" in values]
    return {f"{kind}_psnr": psnr(values[f"{kind}_mse"], peak, factor=3) for kind in kinds}

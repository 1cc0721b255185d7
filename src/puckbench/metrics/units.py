from __future__ import annotations

import math
from collections.abc import Mapping

_DISTANCES = ("hausdorff_point", "hausdorff_plane", "q99_point", "q99_plane")


def distortion_in_metres(values: Mapping[str, float], scale: float) -> dict[str, float]:
    """Convert geometric errors from units of a cloud to metres.

    Parameters
    ----------
    values
        Result of `puckbench.metrics.geometry.distortion`.
    scale
        Units of the cloud per metre.

    Returns
    -------
    dict
        RMS errors, 99 % quantiles and Hausdorff distances in metres. The name ``d1_mse`` becomes
        ``d1_rms_m``; other names get the suffix ``_m``.
    """
    roots = {
        name.removesuffix("_mse") + "_rms_m": math.sqrt(value) / scale
        for name, value in values.items()
        if name.endswith("_mse")
    }
    distances = {
        f"{name}_m": value / scale for name, value in values.items() if name.endswith(_DISTANCES)
    }
    return {**roots, **distances}


def in_square_millimetres(values: Mapping[str, float]) -> dict[str, float]:
    """Convert ``d1_mse`` and ``d2_mse`` of a cloud in metres to ``d1_mm2`` and ``d2_mm2``."""
    return {
        name.removesuffix("_mse") + "_mm2": 1e6 * value
        for name, value in values.items()
        if name in ("d1_mse", "d2_mse")
    }

"""Distortions in metres, from squared units of the scaled cube."""

from __future__ import annotations

import math
from collections.abc import Mapping


def in_metres(values: Mapping[str, float], scale: float) -> dict[str, float]:
    """Root-mean-square errors and Hausdorff distances in metres.

    Parameters
    ----------
    values
        Of `puckbench.metrics.geometry.distortion`, with or without a prefix.
    scale
        Units of the cloud per metre.

    Returns
    -------
    dict
        ``d1_rms_m`` of ``d1_mse``, ``hausdorff_point_m`` of ``hausdorff_point``, and so on.
    """
    roots = {
        name.removesuffix("_mse") + "_rms_m": math.sqrt(value) / scale
        for name, value in values.items()
        if name.endswith("_mse")
    }
    distances = {
        f"{name}_m": value / scale
        for name, value in values.items()
        if name.endswith(("hausdorff_point", "hausdorff_plane"))
    }
    return {**roots, **distances}


def in_square_millimetres(values: Mapping[str, float]) -> dict[str, float]:
    """``d1_mm2`` and ``d2_mm2`` of the ``d1_mse`` and ``d2_mse`` of a cloud in metres."""
    return {
        name.removesuffix("_mse") + "_mm2": 1e6 * value
        for name, value in values.items()
        if name in ("d1_mse", "d2_mse")
    }

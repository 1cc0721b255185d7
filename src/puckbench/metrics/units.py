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

"""Distortions in metres, from squared units of the scaled cube."""

from __future__ import annotations

import math
from collections.abc import Mapping


def in_metres(values: Mapping[str, float], scale: float) -> dict[str, float]:
    """Root-mean-square errors and Hausdorff distances of `values` in metres.

    `scale` is in units per metre. ``d1_mse`` gives ``d1_rms_m``, ``hausdorff_point`` gives
    ``hausdorff_point_m``, and so on, with or without a prefix.
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

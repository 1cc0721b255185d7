from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from pointkit.geometry.cloud import PointCloud
from puckbench.codecs.base import Codec
from puckbench.metrics.psnr import mpeg_psnr

Measures = dict[str, float]


def peak_of(clouds: Sequence[PointCloud]) -> float | None:
    """Return the peak of PSNRs in the clouds' descriptions, or None if they differ."""
    (first, *others) = {cloud.peak for cloud in clouds}
    return None if others else first


def validation(codec: Codec, clouds: Sequence[PointCloud], peak: float | None) -> dict[str, Any]:
    """Return metrics of each rate (``rates``), averaged over the clouds, and their `faults`.

    ``bpp`` is bits per input point; ``d1_mse`` and ``cd_point`` are the maximum and mean of the two
    directions' mean squared distances; ``d1_psnr`` is in dB.
    """
    codec.load()
    rates = {rate: _means(codec, clouds, rate, peak) for rate in codec.rates}
    return {"rates": rates, "faults": faults(rates)}


def _means(codec: Codec, clouds: Sequence[PointCloud], rate: str, peak: float | None) -> Measures:
    values = [_measured(codec, cloud, rate) for cloud in clouds]
    means = {name: float(np.mean([each[name] for each in values])) for name in values[0]}
    return {**means, **(mpeg_psnr(means, peak) if peak and means["d1_mse"] > 0 else {})}


def _measured(codec: Codec, cloud: PointCloud, rate: str) -> Measures:
    from puckbench.metrics.geometry import distortion

    stream = codec.encode(cloud.xyz, rate)
    measures = distortion(PointCloud(cloud.xyz), codec.decode(stream))
    return {
        "bpp": 8 * len(stream) / len(cloud),
        **{name: measures[name] for name in ("d1_mse", "cd_point")},
    }


def faults(rates: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return messages about successive rates whose bits do not grow or distortion does not fall."""
    wrong = []
    for (low, before), (high, after) in pairwise(rates.items()):
        if after["bpp"] <= before["bpp"]:
            wrong.append(f"bpp does not grow from {low} to {high}")
        wrong += [
            f"{name} does not fall from {low} to {high}"
            for name in ("d1_mse", "cd_point")
            if after[name] >= before[name] > 0
        ]
    return wrong

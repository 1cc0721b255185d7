from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from pointkit.geometry.cloud import PointCloud
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import decoded, encoded
from puckbench.codecs.rates import scaled_rates
from puckbench.metrics.psnr import mpeg_psnr

Measures = dict[str, float]
_SIZE = 1024
"""Size of the cube to which clouds are taken to be scaled."""


def peak_of(clouds: Sequence[PointCloud]) -> float | None:
    """Return the PSNR peak in the descriptions of clouds, or None if it is not the same in all."""
    (first, *others) = {cloud.peak for cloud in clouds}
    return None if others else first


def validation(codec: Codec, clouds: Sequence[PointCloud], peak: float | None) -> dict[str, Any]:
    """Encode and decode clouds at all rates of a codec, and measure the decoded clouds.

    Parameters
    ----------
    codec
        The codec with the trained weights.
    clouds
        Prepared clouds.
    peak
        PSNR peak, in the unit of the clouds; None computes no PSNR.

    Returns
    -------
    dict[str, Any]
        ``rates``: for each rate, means over the clouds of ``bpp`` (bits per encoded point),
        ``d1_mse`` (the larger of the two directions' mean squared distances), ``cd_point`` (their
        mean) and ``d1_psnr`` (dB). ``faults``: the messages of `faults`.
    """
    codec.load()
    rates = {rate: _means(codec, clouds, rate, peak) for rate in scaled_rates(codec.rates)}
    return {"rates": rates, "faults": faults(rates)}


def _means(codec: Codec, clouds: Sequence[PointCloud], rate: str, peak: float | None) -> Measures:
    values = [_measured(codec, cloud, rate) for cloud in clouds]
    means = {name: float(np.mean([each[name] for each in values])) for name in values[0]}
    return {**means, **(mpeg_psnr(means, peak) if peak and means["d1_mse"] > 0 else {})}


def _measured(codec: Codec, cloud: PointCloud, rate: str) -> Measures:
    from puckbench.metrics.geometry import distortion

    stream = encoded(codec, PointCloud(cloud.xyz, about={"size": _SIZE}), rate)
    measures = distortion(PointCloud(cloud.xyz), decoded(codec, stream).xyz)
    return {
        "bpp": 8 * len(stream) / len(cloud),
        **{name: measures[name] for name in ("d1_mse", "cd_point")},
    }


def faults(rates: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return messages about rates that are no better than the rate before.

    There is a message if the bits do not grow from one rate to the next, or the distortion does not
    fall.
    """
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

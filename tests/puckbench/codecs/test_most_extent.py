"""What a codec says of the widest cloud at a rate holds: it codes it as exactly as any."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pointkit.errors import InputError
from puckbench.codecs.base import Codec
from puckbench.codecs.registry import codecs, open_codec
from tests.support.learned_codecs import changes, save_tiny, weights_name

NETWORKS = ("sparse_octree_net", "reno")
AT_LENGTHS = [
    name
    for name, kind in codecs().items()
    if kind.takes != "returns" and not getattr(kind, "estimates", False)
    if (codec := open_codec(name)).metric_rates and (codec.available().ok or name in NETWORKS)
]
"""Codecs of points that promise an error at each length."""


def opened(name: str, folder: Path) -> Codec:
    if name not in NETWORKS:
        return open_codec(name)
    save_tiny(name, folder / weights_name(name))
    return open_codec(name, changes(name, folder / weights_name(name)))


def wide(extent: float) -> np.ndarray:
    points = np.random.default_rng(0).random((60, 3)) * [extent, 30, 20]
    points[:2, 0] = [0, extent]
    return points


def largest_error(points: np.ndarray, decoded: np.ndarray) -> float:
    """Largest distance along an axis of a point to the nearest of the other cloud, both ways."""
    pairs = (points, decoded), (decoded, points)
    return float(max(cKDTree(a).query(b, p=np.inf)[0].max() for a, b in pairs))


def bound(codec: Codec, rate: str) -> float:
    """Half a step, and half of a step of the grid that `gpcc_predictive` scales at coarse rates."""
    parameters = codec.parameters_of(rate)
    factor = 2 ** parameters.get("radius_inv_scale_log2", 0)
    return float(parameters["step_m"] * (factor / 2 + (factor > 1) / 2))


def test_there_are_codecs_at_lengths() -> None:
    assert {"gpcc", "gpcc_predictive", "draco", "draco_sequential", "laz"} < set(AT_LENGTHS)


@pytest.mark.parametrize("name", AT_LENGTHS)
def test_the_widest_cloud_is_coded_within_half_a_step(name: str, tmp_path: Path) -> None:
    codec = opened(name, tmp_path)
    first, last = next(iter(codec.metric_rates)), list(codec.metric_rates)[-1]
    for rate, starts in ((first, (0.0, -1.0)), (last, (-0.5, 1e-5))):
        widest = codec.most_extent(rate)
        assert 1000 < widest < math.inf
        for start in starts:
            points = wide(widest)
            points[:, 0] += start * widest
            decoded = codec.decode(codec.encode(points, rate))
            assert largest_error(points, decoded) <= bound(codec, rate) * (1 + 1e-6)


@pytest.mark.parametrize("name", ["gpcc", "draco", *NETWORKS])
def test_a_wider_cloud_is_refused_with_a_remedy(name: str, tmp_path: Path) -> None:
    codec = opened(name, tmp_path)
    rate = list(codec.metric_rates)[-1]
    with pytest.raises(InputError, match="crop it, or take a coarser rate"):
        codec.encode(wide(1.2 * codec.most_extent(rate) + 300), rate)


def test_codecs_that_adapt_to_the_extent_code_any() -> None:
    assert open_codec("draco").most_extent("r3") == math.inf

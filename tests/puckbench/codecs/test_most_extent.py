"""What a codec says of the widest cloud at a rate holds: it codes it as exactly as any."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pointkit.errors import InputError
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.coding import why_not_here
from puckbench.codecs.rates import metric_rates, parameters_of
from puckbench.codecs.registry import codecs, open_codec
from puckbench.codecs.returns_codec import ReturnsCodec
from tests.support.codecs import decode, encode
from tests.support.learned_codecs import changes, save_tiny, weights_name

NETWORKS = ("sparse_octree_net", "reno", "polopcac")
AT_LENGTHS = [
    name
    for name, kind in codecs().items()
    if not (issubclass(kind, ReturnsCodec) or getattr(kind, "estimates", False))
    if metric_rates((codec := open_codec(name)).rates)
    and (not why_not_here(codec) or name in NETWORKS)
]
"""Codecs of points that promise an error at each length."""


def opened(name: str, folder: Path) -> Codec:
    if name not in NETWORKS:
        return open_codec(name)
    save_tiny(name, folder / weights_name(name))
    return open_codec(name, changes(name, folder / weights_name(name)))


def most_extent(codec: Codec, rate: str) -> float:
    """The largest extent, m, of clouds that the codec does not skip at a rate."""
    low, high = 0.0, 1e10
    while high > low * (1 + 1e-12) and high - low > 1e-9:
        middle = (low + high) / 2
        skips = codec.skip(CloudKind("metric", extent_m=middle), rate)
        low, high = (low, middle) if skips else (middle, high)
    return low


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
    parameters = parameters_of(codec, rate)
    factor = 2 ** parameters.get("radius_inv_scale_log2", 0)
    step_m = parameters.get("step_m", parameters.get("posq", 0) / 1000)
    return float(step_m * (factor / 2 + (factor > 1) / 2))


def test_there_are_codecs_at_lengths() -> None:
    assert {"gpcc", "gpcc_predictive", "draco", "draco_sequential", "laz"} < set(AT_LENGTHS)


@pytest.mark.parametrize("name", AT_LENGTHS)
def test_the_widest_cloud_is_coded_within_half_a_step(name: str, tmp_path: Path) -> None:
    codec = opened(name, tmp_path)
    first, *_, last = metric_rates(codec.rates)
    for rate, starts in ((first, (0.0, -1.0)), (last, (-0.5, 1e-5))):
        widest = most_extent(codec, rate)
        assert 1000 < widest < 1e9
        for start in starts:
            points = wide(widest)
            points[:, 0] += start * widest
            decoded = decode(codec, encode(codec, points, rate))
            assert largest_error(points, decoded) <= bound(codec, rate) * (1 + 1e-6)


@pytest.mark.parametrize("name", ["gpcc", "draco", *NETWORKS])
def test_a_wider_cloud_is_refused_with_a_remedy(name: str, tmp_path: Path) -> None:
    codec = opened(name, tmp_path)
    rate = list(metric_rates(codec.rates))[-1]
    with pytest.raises(InputError, match="crop it, or take a coarser rate"):
        encode(codec, wide(1.2 * most_extent(codec, rate) + 300), rate)


def test_codecs_that_adapt_to_the_extent_code_any() -> None:
    assert open_codec("draco").skip(CloudKind("metric", extent_m=1e12), "r3") is None

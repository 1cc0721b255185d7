"""What a codec says of the widest cloud at a rate holds: it codes that one."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from puckbench.codecs.base import Codec
from puckbench.codecs.registry import is_codec, open_codec
from puckbench.core.errors import InputError
from tests.support.learned_codecs import changes, save_tiny, weights_name

WITHOUT_WEIGHTS = (
    "gpcc",
    "gpcc_angular",
    "gpcc_predictive",
    "draco",
    "draco_sequential",
    "laz",
    "cloudini",
)
NETWORKS = ("sparse_octree_net", "reno")


def opened(name: str, folder: Path) -> Codec:
    if name not in NETWORKS:
        return open_codec(name)
    save_tiny(name, folder / weights_name(name))
    return open_codec(name, changes(name, folder / weights_name(name)))


def wide(extent: float) -> np.ndarray:
    points = np.random.default_rng(0).random((60, 3)) * [extent, 30, 20]
    points[:2, 0] = [0, extent]
    return points


@pytest.mark.parametrize("name", [*WITHOUT_WEIGHTS, *NETWORKS])
def test_the_widest_cloud_is_coded(name: str, tmp_path: Path) -> None:
    codec = opened(name, tmp_path)
    first, last = next(iter(codec.metric_rates)), list(codec.metric_rates)[-1]
    for rate, starts in ((first, (0.0, -1.0)), (last, (-0.5, 1e-5))):
        widest = codec.most_extent(rate)
        assert 1000 < widest < math.inf
        for start in starts:
            points = wide(widest)
            points[:, 0] += start * widest
            decoded = codec.decode(codec.encode(points, rate))
            assert np.ptp(decoded[:, 0]) == pytest.approx(widest, rel=1e-5)


@pytest.mark.parametrize("name", ["gpcc", "draco", *NETWORKS])
def test_a_wider_cloud_is_refused_with_a_remedy(name: str, tmp_path: Path) -> None:
    codec = opened(name, tmp_path)
    rate = list(codec.metric_rates)[-1]
    with pytest.raises(InputError, match="crop it, or take a coarser rate"):
        codec.encode(wide(1.2 * codec.most_extent(rate) + 300), rate)


def test_codecs_that_adapt_to_the_extent_code_any() -> None:
    assert open_codec("draco").most_extent("r3") == math.inf
    assert {name for name in (*WITHOUT_WEIGHTS, *NETWORKS) if not is_codec(name)} == set()

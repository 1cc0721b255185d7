"""Rates of PCGCv2+ with its shipped weights: more bits bring a decode nearer."""

from collections.abc import Callable

import numpy as np
import pytest

from pointkit.geometry.cloud import PointCloud
from puckbench.codecs.registry import open_codec
from puckbench.metrics.geometry import distortion
from tests.support.codecs import decode, encode
from tests.support.default_clouds import CLOUDS, RAW_ROOM

_CLOUDS: dict[str, Callable[[], PointCloud]] = {**CLOUDS, "office_1, raw": RAW_ROOM}


@pytest.mark.parametrize(
    ("name", "cloud"),
    [
        ("pcgcv2_plus", "office_1, raw"),
        ("pcgcv2_plus", "chair_01"),
        ("pcgcv2_plus_rooms", "office_1, noisy scan"),
    ],
)
def test_bits_grow_in_steps_below_4_and_distances_fall(name: str, cloud: str) -> None:
    reference, codec, rows = _CLOUDS[cloud](), open_codec(name), []
    for rate in codec.rates:
        stream = encode(codec, reference.xyz, rate)
        result = distortion(reference, decode(codec, stream))
        rows.append([len(stream), result["d1_mse"], result["cd_plane"]])
    steps = np.array(rows)[1:] / np.array(rows)[:-1]
    assert steps[:, 0].min() > 1
    assert steps[:, 0].max() < 4
    assert (steps[:, 1:] < 1).all()

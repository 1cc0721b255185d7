"""Codecs called with bare points or returns, as tests have them."""

from __future__ import annotations

from typing import Any

import numpy as np

from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.returns import Returns
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import decoded, encoded
from puckbench.codecs.rates import is_length


def encode(codec: Codec, points: np.ndarray, rate: str, work: Any = None) -> bytes:
    """The stream of points in the frame that the rate is for."""
    about = {"size": 0 if is_length(codec, rate) else 1024}
    return encoded(codec, PointCloud(points, about=about), rate, work)


def decode(codec: Codec, stream: bytes) -> np.ndarray:
    return decoded(codec, stream).xyz


def encode_returns(codec: Codec, returns: Returns, rate: str) -> bytes:
    return encoded(codec, PointCloud(returns.points(), returns=returns), rate)


def decode_returns(codec: Codec, stream: bytes) -> Returns:
    returns = decoded(codec, stream).returns
    assert returns is not None
    return returns


encode_cloud, decode_cloud = encoded, decoded
"""Verbs, since tests call results `encoded` and `decoded`."""

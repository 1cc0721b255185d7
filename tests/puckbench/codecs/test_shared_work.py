"""Rates share work by an object that the caller passes, and cost what they would cost alone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.codecs.base import Codec, Cost, Parameters, SharedWork
from puckbench.steps.encode import measured_encoding

POINTS = np.arange(30.0).reshape(10, 3)
WORK = Cost(1000.0, 1e6)


class SharedSum(SharedWork):
    """The sum of the coordinates."""

    total: bytes = b""


class Plain(Codec):
    """Codes the sum of the coordinates, by an `_encode` alone."""

    rates: Mapping[str, Parameters] = {"r1": {"digit": b"1"}, "r2": {"digit": b"2"}}

    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        return points.sum().tobytes() + bytes(parameters["digit"])

    def _decode(self, stream: bytes) -> Floats:
        return np.zeros((1, 3))


class Sharing(Plain):
    """Codes the sum, which r2 takes from r1."""

    def shared_work(self) -> SharedSum:
        """The sum."""
        return SharedSum()

    def _encode_sharing(self, points: Floats, parameters: Parameters, shared: SharedSum) -> bytes:
        if parameters["digit"] == b"2" and shared.total:
            shared.saved = WORK
        else:
            shared.total = points.sum().tobytes()
        return shared.total + bytes(parameters["digit"])


@pytest.mark.parametrize("shift", [0.0, 5e6], ids=["near", "far"])
def test_streams_are_the_same_with_shared_work(shift: float) -> None:
    codec, cloud = Sharing("sharing"), PointCloud(POINTS + shift)
    shared = codec.shared_work()
    for rate in ("r1", "r2", "r1"):
        assert codec.encode_cloud(cloud, rate, shared) == codec.encode_cloud(cloud, rate)


def test_a_rate_costs_what_it_would_cost_alone() -> None:
    codec, cloud = Sharing("sharing"), PointCloud(POINTS)
    shared = codec.shared_work()
    first, second, again = (
        measured_encoding(codec, cloud, rate, 2, shared) for rate in ("r1", "r2", "r1")
    )
    assert max(first.most_s, again.most_s) < WORK.seconds < second.least_s
    assert max(first.peak_mib, again.peak_mib) < WORK.peak_mib == second.peak_mib
    assert measured_encoding(codec, cloud, "r2").most_s < WORK.seconds


def test_a_codec_without_shared_work_is_one_with_an_encode_alone() -> None:
    codec, cloud = Plain("plain"), PointCloud(POINTS)
    assert codec.shared_work() is None
    stream = measured_encoding(codec, cloud, "r1", shared=codec.shared_work()).result
    assert stream == codec.encode(POINTS, "r1", SharedSum()) == POINTS.sum().tobytes() + b"1"

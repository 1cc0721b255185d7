"""Rates share work by an object that the caller passes, and cost what they would cost alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from pointkit.geometry.cloud import PointCloud
from pointkit.measurement import Cost
from puckbench.codecs.base import Codec, Parameters, SharedWork
from puckbench.results.curves import Coded
from puckbench.steps.coding import TimingSettings
from puckbench.steps.encode import coded_cloud
from tests.support.codecs import encode, encode_cloud

POINTS = np.arange(30.0).reshape(10, 3)
WORK = Cost(1000.0, 1e6)


class SharedSum(SharedWork):
    """The sum of the coordinates."""

    total: bytes = b""


class Plain(Codec):
    """Codes the sum of the coordinates."""

    rates: Mapping[str, Parameters] = {"r1": {"digit": b"1"}, "r2": {"digit": b"2"}}

    def encode(self, cloud: PointCloud, rate: str, work: Any = None) -> bytes:
        return cloud.xyz.sum().tobytes() + bytes(self.rates[rate]["digit"])

    def decode(self, stream: bytes) -> PointCloud:
        return PointCloud(np.zeros((1, 3)))


class Sharing(Plain):
    """Codes the sum, which r2 takes from r1."""

    def prepare(self, cloud: PointCloud) -> SharedSum:
        """The sum."""
        return SharedSum()

    def encode(self, cloud: PointCloud, rate: str, work: SharedSum | None = None) -> bytes:
        work = work or SharedSum()
        if rate == "r2" and work.total:
            work.saved = WORK
        else:
            work.total = cloud.xyz.sum().tobytes()
        return work.total + bytes(self.rates[rate]["digit"])


def coded(codec: Codec, cloud: PointCloud, rate: str, work: SharedWork | None = None) -> Coded:
    return coded_cloud(codec, cloud, rate, TimingSettings(repeats=2), work)


@pytest.mark.parametrize("shift", [0.0, 5e6], ids=["near", "far"])
def test_streams_are_the_same_with_shared_work(shift: float) -> None:
    codec, cloud = Sharing("sharing"), PointCloud(POINTS + shift)
    shared = codec.prepare(cloud)
    for rate in ("r1", "r2", "r1"):
        assert encode_cloud(codec, cloud, rate, shared) == encode_cloud(codec, cloud, rate)


def test_a_rate_costs_what_it_would_cost_alone() -> None:
    codec, cloud = Sharing("sharing"), PointCloud(POINTS)
    shared = codec.prepare(cloud)
    first, second, again = (coded(codec, cloud, rate, shared).record for rate in ("r1", "r2", "r1"))
    assert max(first["encode_s"], again["encode_s"]) < WORK.seconds < second["encode_s"]
    peak = "encode_peak_mib"
    assert max(first[peak], again[peak]) < WORK.peak_mib == second[peak]
    assert coded(codec, cloud, "r2").record["encode_s"] < WORK.seconds


def test_a_codec_without_shared_work_is_one_with_an_encode_alone() -> None:
    codec, cloud = Plain("plain"), PointCloud(POINTS)
    assert codec.prepare(cloud) is None
    stream = coded(codec, cloud, "r1", codec.prepare(cloud)).stream
    assert stream == encode(codec, POINTS, "r1", SharedSum()) == POINTS.sum().tobytes() + b"1"

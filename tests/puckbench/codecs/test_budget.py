"""Budgets of bits: streams take 98 to 100 % of them, or the most that a codec can."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

import puckbench
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.sensors import load_sensor
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.budget import MOST_PROBES, rate_within
from puckbench.codecs.coding import skip_reason
from puckbench.codecs.rates import Budget, budgets_of, lengths
from puckbench.codecs.registry import open_codec
from tests.support.pages import blocks
from virtual_lidar import open_error_model, open_sweep, scan
from virtual_lidar.scan_returns import returns_of_scan
from virtual_lidar.scenes.street import make_street, street_origin

FREE = ("cloudini", "draco", "draco_sequential", "gpcc", "gpcc_angular", "laz")
OF_RETURNS = ("jpegls", "jpegxl", "puck", "puck_smoothed")


@cache
def turn() -> PointCloud:
    """A turn of a virtual VLP-16 in a street, with noise: 5,000 points in metres, and returns."""
    spin = {"preset": "spin", "rotation_hz": 10, "frames_per_second": 10, "duration_s": 0.1}
    sweep = open_sweep({**spin, "azimuth_step_deg": 0.8})
    model, random = open_error_model("vlp16", None), np.random.default_rng(5)
    mesh, sensor = make_street("street_1", seed=1, length=60.0), load_sensor("vlp16")
    returns = returns_of_scan(scan(mesh, sensor, sweep, model, street_origin(), random)).returns
    return PointCloud(returns.points(), returns=returns, about={"size": 0})


@cache
def scaled() -> PointCloud:
    points = turn().xyz - turn().xyz.min(axis=0)
    return PointCloud(points / points.max() * 1023, about={"size": 1024})


def bits_per_point(stream: bytes, cloud: PointCloud) -> float:
    return 8 * len(stream) / len(cloud)


@pytest.mark.parametrize("bpp", [6.0, 24.0])
@pytest.mark.parametrize("name", FREE)
def test_a_free_step_meets_a_budget_within_two_percent(name: str, bpp: float) -> None:
    codec, cloud = open_codec(name), turn()
    if reason := skip_reason(codec, CloudKind.of(cloud), "10mm"):
        pytest.skip(reason)
    found = puckbench.encoded_within(codec, cloud, bpp)
    assert 0.98 * bpp <= bits_per_point(found.stream, cloud) == found.bpp <= bpp
    assert found.encodings <= MOST_PROBES
    assert found.remark is None
    assert puckbench.encoded(codec, cloud, found.rate) == found.stream
    decoded = puckbench.decoded(codec, found.stream)
    step_mm = float(found.rate.removesuffix("mm"))
    assert cKDTree(decoded.xyz).query(cloud.xyz)[0].max() <= step_mm / 1000


@pytest.mark.parametrize("name", OF_RETURNS)
def test_codecs_of_returns_take_the_finest_multiple_of_the_range_unit(name: str) -> None:
    codec, cloud = open_codec(name), turn()
    found = puckbench.encoded_within(codec, cloud, 5.0)
    quanta = round(float(found.rate.removesuffix("mm")) / 2)
    assert bits_per_point(found.stream, cloud) <= 5.0
    finer = puckbench.encoded(codec, cloud, f"{2 * (quanta - 1)}mm")
    assert bits_per_point(finer, cloud) > 5.0
    assert found.encodings <= MOST_PROBES
    is_met = found.bpp >= 0.98 * 5.0
    assert (found.remark is None) == is_met
    assert len(puckbench.decoded(codec, found.stream)) > 0


def test_scaled_clouds_get_any_scale_of_a_grid() -> None:
    codec, cloud = open_codec("gpcc"), scaled()
    found = puckbench.encoded_within(codec, cloud, 4.0)
    assert 0.98 * 4 <= bits_per_point(found.stream, cloud) <= 4
    scale = float(found.rate.removeprefix("scale_"))
    same = open_codec("gpcc", {"rates": {"mine": {"scale": scale}}})
    assert puckbench.encoded(same, cloud, "mine") == found.stream
    assert len(puckbench.decoded(codec, found.stream)) > 0


@pytest.mark.parametrize("name", ["draco", "pcgcv2_plus"])
def test_fixed_rates_are_the_largest_below_and_say_so(name: str) -> None:
    codec, cloud = open_codec(name), scaled()
    codec.rates = dict(list(codec.rates.items())[:5])
    bits = {
        rate: bits_per_point(puckbench.encoded(codec, cloud, rate), cloud) for rate in codec.rates
    }
    budget = 1.01 * bits["r3"]
    best = max((rate for rate in bits if bits[rate] <= budget), key=bits.__getitem__)
    found = puckbench.encoded_within(codec, cloud, budget)
    assert (found.rate, found.bpp) == (best, bits[best])
    assert found.encodings <= 3
    assert found.remark is not None
    assert f"codec {name} has fixed rates: {best} takes {bits[best]:.4g} bits" in found.remark


def test_what_a_codec_cannot_reach_is_refused_with_its_range() -> None:
    cloud = turn()
    with pytest.raises(InputError, match=r"0.001bpp is out of reach, which is from .* \(.*mm\) to"):
        puckbench.encoded_within(open_codec("gpcc"), cloud, 0.001)
    draco, cloud = open_codec("draco"), scaled()
    least, most = (
        f"{bits_per_point(puckbench.encoded(draco, cloud, rate), cloud):.4g} bits per point"
        for rate in ("r1", "r8")
    )
    with pytest.raises(InputError) as fault:
        puckbench.encoded_within(draco, cloud, 0.01)
    assert f"from {least} (r1) to {most} (r8)" in str(fault.value)


def test_more_bits_than_lossless_coding_needs_give_the_finest_rate() -> None:
    codec, cloud = open_codec("jpegls"), turn()
    found = puckbench.encoded_within(codec, cloud, 500.0)
    assert found.rate == "2mm"
    assert found.stream == puckbench.encoded(codec, cloud, "2mm")
    told = f"its finest rate, 2mm, takes {found.bpp:.4g} bits per point of 500bpp"
    assert told in str(found.remark)


class Strange(Codec):
    """A codec whose sizes depend on the step as a test says."""

    rates = lengths()

    def __init__(self, size) -> None:  # noqa: ANN001
        super().__init__("strange")
        self.size, self.calls = size, []

    def encode(self, cloud: PointCloud, rate: str, work: object = None) -> bytes:
        self.calls.append(rate)
        return bytes(max(1, int(self.size(float(rate.removesuffix("mm"))))))

    def decode(self, stream: bytes) -> PointCloud:
        raise NotImplementedError


POINTS = PointCloud(np.random.default_rng(0).random((1000, 3)) * 50, about={"size": 0})


@pytest.mark.parametrize("seed", range(40))
def test_a_search_ends_whatever_the_sizes_are(seed: int) -> None:
    codec = Strange(lambda mm: 1500 * (1 + np.sin(1e3 * np.log(mm) + seed)) + 20)
    try:
        found = puckbench.encoded_within(codec, POINTS, 4.0)
    except InputError:
        assert len(codec.calls) <= MOST_PROBES + 2
    else:
        assert found.bpp <= 4.0
        assert found.encodings == len(codec.calls) <= MOST_PROBES
        assert len({*codec.calls}) == len(codec.calls)
        within = [8 * int(codec.size(float(rate[:-2]))) / 1000 for rate in codec.calls]
        assert found.bpp == max(bits for bits in within if bits <= 4.0)


def test_leaps_of_the_size_leave_the_largest_below() -> None:
    codec = Strange(lambda mm: 4000 * 2.0 ** -np.round(np.log2(mm)))
    found = puckbench.encoded_within(codec, POINTS, 6.0)
    assert found.bpp == 4.0  # 8 bits at steps below 5.66 mm, 4 up to 11.3 mm
    assert "the most within 6bpp" in str(found.remark)
    assert len(codec.calls) <= MOST_PROBES


@pytest.mark.parametrize("bpp", np.geomspace(0.3, 40, 12))
def test_a_search_takes_few_encodings_of_laws_of_entropy(bpp: float) -> None:
    """Points on a surface: bits per point fall as 1 / step, and by 3 for each doubling if small."""
    codec = Strange(lambda mm: 1000 / 8 * 3 * np.log2(1 + (40 / mm) ** 1.3) + 15)
    found = puckbench.encoded_within(codec, POINTS, float(bpp))
    assert found.remark is None
    assert len(codec.calls) <= 7


def test_turns_share_one_step_and_seconds_make_bits() -> None:
    codec, turns = open_codec("gpcc"), [turn(), turn(), turn()]
    sizes: dict[str, int] = {}

    def encode(rated: Codec, rate: str) -> int:
        sizes[rate] = sum(len(puckbench.encoded(rated, cloud, rate)) for cloud in turns)
        return sizes[rate]

    chosen = rate_within(codec, turns, Budget(0.4, "mbps"), encode, seconds=0.3)
    assert 0.98 * 0.4 <= 8e-6 * sizes[chosen.rate] / 0.3 <= 0.4
    with pytest.raises(InputError, match="mbps: the time in which the points were recorded"):
        rate_within(codec, turns, Budget(0.4, "mbps"), encode)


def test_the_example_of_the_page_runs() -> None:
    code = blocks("docs/how-to/meet_a_bit_budget.md", "python")[0]
    exec(code, {"points": turn().xyz})  # noqa: S102


@pytest.mark.parametrize("bpp", [0, -1.0, float("nan"), float("inf"), "1"])
def test_budgets_are_numbers_above_0(bpp: object) -> None:
    with pytest.raises(InputError, match="must be a number above 0"):
        puckbench.encoded_within(open_codec("draco"), POINTS, bpp)  # type: ignore[arg-type]


def test_points_without_a_frame_are_in_metres() -> None:
    found = puckbench.encoded_within(open_codec("gpcc"), turn().xyz, 3.0)
    assert found.rate.endswith("mm")
    assert 0.98 * 3 <= found.bpp <= 3


def test_an_entry_names_budgets_or_rates() -> None:
    codec = open_codec("gpcc", {"rates": ["2bpp", "0.5bpp"]})
    assert budgets_of(codec) == ("0.5bpp", "2bpp")
    assert "r1" in codec.rates
    for entry, fault in (
        ({"rates": ["1bpp", "r3"]}, "budgets such as 1bpp stand alone, without r3"),
        ({"metric_rates": ["2mbps"]}, "2mbps: megabits per second are for drives"),
        ({"rates": ["0bpp"]}, "a budget must be above 0"),
        ({"rates": ["1bp"]}, "unknown rate '1bp'"),
    ):
        with pytest.raises(InputError, match=fault):
            open_codec("gpcc", entry)

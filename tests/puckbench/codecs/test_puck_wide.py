"""Codecs of ranges with 32 bits, and the size of a scan by 128 lasers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import puck
from pointkit.coding.zstandard import compressed
from pointkit.lidar.sensor import Sensor
from pointkit.lidar.turns import MAX_RANGE, Turn
from puckbench.codecs.coding import why_not_here
from puckbench.codecs.registry import open_codec
from puckbench.codecs.returns_codec import ReturnsCodec
from tests.support.codecs import decode_returns, encode_returns
from tests.support.returns import staggered
from virtual_lidar import open_error_model, open_sweep, scan
from virtual_lidar.scan_returns import returns_of_scan
from virtual_lidar.scenes.rooms import make_room, room_origin


@pytest.mark.parametrize("name", ["jpegls", "jpegxl"])
def test_images_hold_ranges_of_32_bits(name: str) -> None:
    codec = open_codec(name)
    assert isinstance(codec, ReturnsCodec)
    if why_not_here(codec):
        pytest.skip(why_not_here(codec))
    random = np.random.default_rng(0)
    ranges = random.integers(0, MAX_RANGE + 1, (2, 40, 20), dtype=np.uint32)
    ranges[1, ::2] = ranges[0, ::2]
    ranges[:, 5, 0] = [[0], [MAX_RANGE]][0]
    returns = staggered()
    turn = Turn(ranges, np.arange(40, dtype=np.uint16))
    layout = replace(returns.layout, kinds=2)
    wide = replace(returns, layout=layout, turns=(turn,))
    decoded = decode_returns(codec, encode_returns(codec, wide, "2mm"))
    assert replace(decoded, turns=()) == replace(wide, turns=())
    np.testing.assert_array_equal(decoded.turns[0].ranges, ranges)
    coarse = decode_returns(codec, encode_returns(codec, wide, "100mm")).turns[0].ranges
    assert np.abs(coarse.astype(np.int64) - ranges).max() <= 25


@pytest.mark.parametrize(("effort", "share"), [("fast", 0.65), ("normal", 0.6)])
def test_a_scan_in_millimetres_by_128_lasers_costs_few_bits(effort: str, share: float) -> None:
    """Ranges of a furnished room with noise of 3 mm, whose entropy is 3.6 bits, and its image as
    Zstandard compresses it."""
    columns, lasers = 512, 128
    sensor = Sensor(
        name="OS", laser_elevation_deg=tuple(np.linspace(22.5, -22.5, lasers).tolist()),
        rotation_hz=10.0, azimuth_step_deg=360 / columns, max_range_m=120.0, range_quantum_mm=1.0,
    )  # fmt: skip
    sweep = open_sweep(
        {"frames_per_second": 10.0, "duration_s": 0.2, "pitch_start_deg": 0, "pitch_end_deg": 0}
    )
    model = open_error_model("vlp16", {"bias_sigma_m": 0.0, "ray_sigma_m": 0.003})
    random, place = np.random.default_rng(0), room_origin("office_1")
    scanned = returns_of_scan(scan(make_room("office_1", 0), sensor, sweep, model, place, random))
    azimuths = np.arange(columns, dtype=np.uint16)
    turns = tuple(replace(turn, azimuths=azimuths) for turn in scanned.returns.turns)
    layout = replace(scanned.returns.layout, azimuth_steps=columns)
    returns = replace(scanned.returns, layout=layout, turns=turns)
    images = [np.ascontiguousarray(turn.ranges[0].T) for turn in turns]
    assert images[0].dtype == np.uint32
    assert images[0].shape == (lasers, columns)
    options = puck.CodingOptions(effort=effort, times=False)  # type: ignore[arg-type]
    stream = puck.encode_returns(returns, options)
    assert len(stream) < share * sum(len(compressed(image.tobytes())) for image in images)
    assert 8 * len(stream) / len(returns) < 5.3

"""The octree with angular mode as a codec of clouds in metres, with and without returns."""

import numpy as np
import pytest

from gpcc.coder import decode_geometry, encode_geometry
from gpcc.grid import unwrap
from gpcc.options import PROFILES
from gpcc.sensor import SensorDescription
from pointkit.errors import InputError
from puckbench.codecs.rates import metric_rates
from puckbench.codecs.registry import open_codec
from tests.support.codecs import decode, encode, encode_returns
from tests.support.returns import EXAMPLES, recorded
from tests.support.small_turn import SENSOR, small_turn


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.parametrize("rate", ["100mm", "10mm", "1mm"])
def test_returns_come_back_to_within_the_grid(name: str, rate: str) -> None:
    returns = EXAMPLES[name]()
    codec = open_codec("gpcc_angular", {"options": {"duplicates": "kept"}})
    step = codec.rates[rate]["step_m"]
    decoded = np.rint(decode(codec, encode_returns(codec, returns, rate)) / step)
    expected = returns.points() / step
    assert len(decoded) == len(returns)
    order, expected_order = np.lexsort(decoded.T), np.lexsort(np.rint(expected).T)
    assert np.abs(decoded[order] - expected[expected_order]).max() < 0.5 + 1e-6


@pytest.mark.parametrize("rate", ["100mm", "5mm", "2mm", "1mm"])
def test_points_of_one_position_are_merged_where_there_is_loss(rate: str) -> None:
    """MPEG's common test conditions have mergeDuplicatedPoints 1 with loss, 0 without."""
    twice = np.repeat(recorded(60).points(), 2, axis=0)
    codec = open_codec("gpcc_angular")
    decoded = decode(codec, encode(codec, twice, rate))
    steps = np.rint(twice / codec.rates[rate]["step_m"])
    lossless = rate in ("2mm", "1mm")
    assert len(decoded) == (len(twice) if lossless else len(np.unique(steps, axis=0)))


def test_points_of_one_position_are_merged_below_scale_1() -> None:
    scaled = np.array([[0.0, 0, 0], [0, 0, 0], [9, 9, 9], [80, 10, 3]])
    codec = open_codec("gpcc_angular")
    counts = [len(decode(codec, encode(codec, scaled, rate))) for rate in ("r7", "r8")]
    assert counts == [3, 4]
    merged = open_codec("gpcc_angular", {"options": {"duplicates": "merged"}})
    assert len(decode(merged, encode(merged, scaled, "r8"))) == 3


def test_the_sensor_saves_bits() -> None:
    codec, returns = open_codec("gpcc_angular"), recorded(60)
    assert next(iter(metric_rates(codec.rates))) == "100mm"
    for rate, share in {"10mm": 1.0, "1mm": 0.95}.items():
        with_sensor = len(encode_returns(codec, returns, rate))
        assert with_sensor < share * len(encode(codec, returns.points(), rate))


def test_points_of_any_node_coded_directly_take_more_bits() -> None:
    """Mode 3 is that of the common test conditions."""
    ours, returns = open_codec("gpcc_angular"), recorded(60)
    theirs = open_codec("gpcc_angular", {"options": {"direct_coding": 3}})
    for rate in ("10mm", "1mm"):
        assert len(encode_returns(ours, returns, rate)) < len(encode_returns(theirs, returns, rate))


def test_a_stream_is_one_that_gpcc_decodes() -> None:
    returns = recorded(60)
    stream = encode_returns(open_codec("gpcc_angular"), returns, "2mm")
    assert np.array_equal(
        decode_geometry(unwrap(stream).stream).positions() * 0.002,
        decode(open_codec("gpcc"), stream),
    )


def test_a_sensor_too_far_away_is_refused_by_the_encoder() -> None:
    far = SensorDescription(SENSOR.tan_elevation, SENSOR.height, 450, (1 << 23, 0, 0))
    with pytest.raises(InputError, match="the sensor is more than 4194304 units away"):
        encode_geometry(small_turn().astype(int), PROFILES["ctc"], sensor=far)


@pytest.mark.parametrize("points", [(1 << 22) - 8000, 1 << 21])
def test_a_sensor_at_the_bound_is_coded(points: int) -> None:
    """Where the reference's numbers of 32 bits are large, too."""
    away = SensorDescription(SENSOR.tan_elevation, SENSOR.height, 450, (points, -points, 5))
    grid = small_turn().astype(int)
    options = PROFILES["ctc"].model_copy(update={"inferred_direct_coding_mode": 3})
    decoded = decode_geometry(encode_geometry(grid, options, sensor=away)).positions()
    unique = np.unique(grid, axis=0)
    assert np.array_equal(np.unique(decoded, axis=0), unique)

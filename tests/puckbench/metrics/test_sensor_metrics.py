"""Errors of ranges, and how a codec keeps up with a sensor, against numbers by hand."""

from dataclasses import replace

import numpy as np
import pytest

from pointkit.errors import InputError
from puckbench.metrics.sensor_metrics import (
    entropy_bits,
    range_errors,
    range_errors_of_points,
    real_time_metrics,
)
from tests.support.returns import homemade


def test_ranges_are_compared_firing_by_firing() -> None:
    original = homemade()
    turn = original.turns[0]
    ranges = turn.ranges.copy()
    places = np.argwhere(ranges > 0)
    empty = np.argwhere(ranges == 0)
    ranges[tuple(places[0])] += 3  # 12 mm
    ranges[tuple(places[1])] -= 4  # 16 mm
    ranges[tuple(places[2])] = 0
    ranges[tuple(empty[0])] = 700
    ranges[tuple(empty[1])] = 701
    decoded = replace(original, turns=(replace(turn, ranges=ranges), original.turns[1]))
    values = range_errors(original, decoded)
    both = 2 * len(places) - 1
    assert values == {
        "range_rms_mm": pytest.approx(np.sqrt((144 + 256) / both)),
        "range_max_mm": pytest.approx(16),
        "returns_lost": 1,
        "returns_added": 2,
    }


def test_other_firings_are_refused() -> None:
    original = homemade()
    with pytest.raises(InputError, match="numbers of turns, columns or lasers differ"):
        range_errors(original, replace(original, turns=original.turns[:1]))
    with pytest.raises(InputError, match="numbers of turns, columns or lasers differ"):
        range_errors(original, homemade(columns=80))


def test_points_without_lasers_are_compared_along_the_rays() -> None:
    random = np.random.default_rng(0)
    rays = random.normal(size=(300, 3))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    ranges = random.uniform(2, 40, 300)
    original = ranges[:, None] * rays
    errors = random.normal(0, 0.004, 300)
    values = range_errors_of_points(original, (ranges + errors)[::-1, None] * rays[::-1])
    assert values["range_rms_mm"] == pytest.approx(1000 * np.sqrt(np.mean(errors**2)))
    assert values["range_max_mm"] == pytest.approx(1000 * np.abs(errors).max())
    assert values["returns_lost"] == values["returns_added"] == 0


def test_merged_points_are_lost_returns_and_points_of_no_return_are_added() -> None:
    original = np.array([[4.0, 0, 0], [4.001, 0, 0], [0, 9, 0], [0, 9, 0]])
    decoded = np.array([[4.0, 0, 0], [0, 9.003, 0], [0, 9.003, 0], [0, 0, 7], [4, 4, 0]])
    assert range_errors_of_points(original, decoded) == {
        "range_rms_mm": pytest.approx(np.sqrt((1 + 9 + 9) / 4)),
        "range_max_mm": pytest.approx(3),
        "returns_lost": 1,
        "returns_added": 2,
    }


def test_a_codec_keeps_up_with_the_sensor() -> None:
    row = {"bytes": 25_000, "encode_s": 0.05, "decode_s": 0.4}
    values = real_time_metrics({"turns": 2, "seconds": 0.2}, row)
    assert values == {
        "mbit_per_s": pytest.approx(1.0),
        "encode_ms_per_turn": pytest.approx(25),
        "encode_real_time": pytest.approx(4),
        "decode_ms_per_turn": pytest.approx(200),
        "decode_real_time": pytest.approx(0.5),
    }
    assert real_time_metrics({"turns": 2}, row) == {}
    assert real_time_metrics({"turns": 1, "seconds": 0.1}, {}) == {}


def test_entropy_of_noise_is_that_of_its_distribution() -> None:
    random = np.random.default_rng(5)
    groups = np.repeat(np.arange(4), 50_000)
    noise = random.normal(0, 0.01, len(groups)) + np.array([0.3, -0.2, 0.0, 0.1])[groups]
    # Of a Gaussian of five steps: log2(5 sqrt(2 pi e)).
    gaussian = np.log2(5 * np.sqrt(2 * np.pi * np.e))
    assert entropy_bits(noise, groups, 0.002) == pytest.approx(gaussian, abs=0.005)
    steps = random.integers(0, 8, len(groups)) * 0.002
    assert entropy_bits(steps, np.zeros(len(groups), int), 0.002) == pytest.approx(3, abs=0.001)
    assert entropy_bits(np.zeros(50), np.zeros(50, int), 0.002) == 0


def test_noise_whose_deviation_can_be_known_costs_less_than_pooled() -> None:
    """Deviations of 5 and 20 steps in halves of the incidences: the mean of both entropies."""
    random = np.random.default_rng(6)
    incidence = random.random(400_000)
    steps = np.where(incidence < np.median(incidence), 5, 20)
    noise, groups = random.normal(0, 0.002 * steps), np.zeros(len(steps), int)
    expected = np.mean([np.log2(s * np.sqrt(2 * np.pi * np.e)) for s in (5, 20)])
    ranges = random.random(len(steps))
    conditional = entropy_bits(noise, groups, 0.002, (incidence, ranges))
    assert conditional == pytest.approx(expected, abs=0.005)
    assert entropy_bits(noise, groups, 0.002) > expected + 0.2

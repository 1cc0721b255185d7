"""Intervals and verdicts against closed forms, scipy, and the share of intervals that hold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from puckbench.metrics.statistics import (
    BETTER,
    MIN_SCENES,
    NO_VERDICT,
    NOT_WORSE,
    UNDECIDED,
    WORSE,
    Estimate,
    means_over_seeds,
    with_scenes,
)

DRAWS = 20_000
DIFFERENCES = {
    "normal": lambda rng, size: rng.normal(size=size),
    "uniform": lambda rng, size: rng.uniform(-1, 1, size),
    "t5": lambda rng, size: rng.standard_t(5, size),
}
"""Distributions about 0."""


@pytest.mark.parametrize("count", [6, 7, 16])
def test_the_interval_is_that_of_students_t(count: int) -> None:
    values = np.random.default_rng(count).normal(3, 2, count)
    estimate = Estimate.of(values)
    expected = stats.t.interval(0.95, count - 1, values.mean(), stats.sem(values))
    assert (estimate.low, estimate.high) == pytest.approx(expected, rel=1e-12)
    assert estimate.mean == pytest.approx(values.mean())
    assert (estimate.least, estimate.most) == (values.min(), values.max())


def test_six_values_by_hand() -> None:
    """Mean 0, variance 6/5, and the tabled quantile 2.5706 of five degrees of freedom."""
    estimate = Estimate.of([-1, 1, -1, 1, -1, 1])
    half = 2.5706 * (6 / 5 / 6) ** 0.5
    assert (estimate.mean, estimate.low, estimate.high) == pytest.approx((0, -half, half), abs=1e-4)


def test_fewer_than_six_values_have_no_interval_and_none_has_no_mean() -> None:
    assert MIN_SCENES == 6
    five = Estimate.of([1, 2, 3, 4, 5, np.nan])
    assert (five.mean, five.least, five.most, five.scenes) == (3, 1, 5, 5)
    assert np.isnan([five.low, five.high]).all()
    none = Estimate.of([np.nan])
    assert (none.scenes, np.isnan(none.mean)) == (0, True)


def test_ratios_are_averaged_in_their_logarithm() -> None:
    ratios = [0.5, 2, 1, 4, 1, 0.25]
    estimate, logs = Estimate.of_ratios(ratios), Estimate.of(np.log(ratios))
    assert estimate.mean == pytest.approx(1)
    ends = np.exp([logs.low, logs.high])
    assert (estimate.low, estimate.high) == pytest.approx(tuple(ends))
    assert (estimate.least, estimate.most) == pytest.approx((0.25, 4))
    inverse = Estimate.of_ratios(1 / np.array(ratios))
    assert (inverse.low, inverse.high) == pytest.approx((1 / ends[1], 1 / ends[0]))


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [
        (-2, -1e-9, BETTER),
        (-2, 0, NOT_WORSE),
        (-2, 0.99, NOT_WORSE),
        (0.5, 0.99, NOT_WORSE),  # worse, but by less than the margin
        (-2, 1, UNDECIDED),
        (0, 1, UNDECIDED),
        (1e-9, 1, WORSE),
    ],
)
def test_verdicts_at_their_boundaries(low: float, high: float, verdict: str) -> None:
    mean = (low + high) / 2
    assert Estimate(mean, low, high, low, high, 6).verdict(1.0) == verdict
    assert Estimate(mean, low, high, low, high, 5).verdict(1.0) == NO_VERDICT


def test_without_a_margin_nothing_is_not_worse_but_what_is_better() -> None:
    assert Estimate(0.1, -0.1, 0.3, 0, 1, 6).verdict(0.0) == UNDECIDED
    assert Estimate(0.2, 0.1, 0.3, 0, 1, 6).verdict(0.0) == WORSE
    assert Estimate(-0.2, -0.3, -0.1, 0, 1, 6).verdict(0.0) == BETTER


def test_seeds_of_a_scene_count_once() -> None:
    table = pd.DataFrame(
        {
            "codec": ["a", "a", "a", "a", "b"],
            "cloud": ["x-1", "x-2", "x-3", "y", "y"],
            "scene": ["x", "x", "x", None, None],
            "bpp": [1.0, 2.0, 6.0, 5.0, 7.0],
        }
    )
    means = means_over_seeds(table, ["codec"], ["bpp"])
    assert means.to_numpy().tolist() == [["a", "x", 3.0], ["a", "y", 5.0], ["b", "y", 7.0]]
    assert Estimate.of(means["bpp"]).scenes == 3
    without = with_scenes(table.drop(columns="scene"))
    assert without["scene"].tolist() == table["cloud"].tolist()


@pytest.mark.parametrize("draw", DIFFERENCES.values(), ids=DIFFERENCES)
@pytest.mark.parametrize("scenes", [6, 9, 16])
def test_intervals_hold_the_mean_as_often_as_they_say(
    scenes: int, draw: Callable[[np.random.Generator, tuple[int, int]], np.ndarray]
) -> None:
    """The half widths are `Estimate`'s own: those of its first draw, in standard errors."""
    samples = draw(np.random.default_rng(scenes), (DRAWS, scenes))
    means = samples.mean(axis=1)
    errors = samples.std(axis=1, ddof=1) / scenes**0.5
    first = Estimate.of(samples[0])
    halves = (first.high - first.mean) / errors[0] * errors
    last = Estimate.of(samples[-1])
    assert (means[-1] - halves[-1], means[-1] + halves[-1]) == pytest.approx((last.low, last.high))
    assert np.mean(np.abs(means) < halves) == pytest.approx(0.95, abs=0.02)
    assert np.mean(means + halves < 0) <= 0.035  # "better" of codecs that are equal

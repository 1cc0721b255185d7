"""Medians per bin and per rate against computations made without pandas' binning."""

import numpy as np
import pandas as pd
import pytest

from puckbench.core.seeding import generator
from puckbench.figures.binning import (
    equal_count_medians,
    medians_against,
    medians_per_rate,
    ordered_rates,
)
from tests.support.figures_lookalike import metrics_table


@pytest.mark.parametrize("count", [24, 97, 1000])
def test_bins_hold_equal_counts_and_give_their_medians(count: int) -> None:
    rng = generator(1, "bins")
    x, y = rng.lognormal(size=count), rng.lognormal(size=count)
    inner = np.quantile(x, np.arange(1, 10) / 10)
    bin_of = np.searchsorted(inner, x, side="left")
    expected = [(np.median(x[bin_of == b]), np.median(y[bin_of == b])) for b in range(10)]
    curve = equal_count_medians(x, y)
    np.testing.assert_allclose(np.transpose(curve[:2]), expected)
    quartiles = [np.quantile(y[bin_of == b], (0.25, 0.75)) for b in range(10)]
    np.testing.assert_allclose(np.transpose(curve[2:]), quartiles)
    assert np.ptp(np.bincount(bin_of)) <= 1


def test_fewer_distinct_values_than_bins_give_one_point_each() -> None:
    x = np.array([4.0, 1.0, 2.0, 2.0])
    bpp, values, *_ = equal_count_medians(x, 10 * x)
    assert bpp.tolist() == [1.0, 2.0, 4.0]
    assert values.tolist() == [10.0, 20.0, 40.0]


def test_one_distinct_value_is_one_bin() -> None:
    curve = equal_count_medians(np.full(3, 0.5), np.array([1.0, 5.0, 2.0]))
    assert [values.tolist() for values in curve] == [[0.5], [2.0], [1.5], [3.5]]


def test_pairs_with_a_missing_value_are_left_out() -> None:
    x = np.array([1.0, 2.0, np.nan, 3.0])
    y = np.array([10.0, np.nan, 20.0, 30.0])
    bpp, values, *_ = equal_count_medians(x, y)
    assert (bpp.tolist(), values.tolist()) == ([1.0, 3.0], [10.0, 30.0])
    assert all(len(part) == 0 for part in equal_count_medians(x[2:3], y[2:3]))


def _two_codes_of(clouds: int) -> pd.DataFrame:
    """Rates of 1, 2 and 4 bpp, where the last cloud takes twice the bits for the same values."""
    rows = [
        {"cloud": f"c{n}", "rate": f"r{k}", "bpp": 2.0**k * (1 + (n == clouds - 1)), "cd": 10.0 - k}
        for n in range(clouds)
        for k in (2, 0, 1)
    ]
    return pd.DataFrame(rows)


def test_few_clouds_have_a_median_for_each_rate() -> None:
    """In bins by bpp one cloud's r2 and the other's r1 would fall together, or in turns."""
    bpp, values, *_ = medians_against(_two_codes_of(2), "bpp", "cd")
    assert (bpp.tolist(), values.tolist()) == ([1.5, 3.0, 6.0], [10.0, 9.0, 8.0])


def test_as_many_clouds_as_bins_are_binned() -> None:
    rows = _two_codes_of(10)
    binned = equal_count_medians(rows["bpp"].to_numpy(), rows["cd"].to_numpy())
    np.testing.assert_array_equal(medians_against(rows, "bpp", "cd"), binned)
    assert binned[0].tolist() == [1.0, 2.0, 4.0, 8.0]


def test_medians_per_rate_are_those_of_the_rows() -> None:
    table = metrics_table(clouds=5)
    medians = medians_per_rate(table, "cd_plane").set_index(["dataset", "codec", "rate"])
    rows = [
        value
        for dataset, codec, rate, value in table[
            ["dataset", "codec", "rate", "cd_plane"]
        ].itertuples(index=False)
        if (dataset, codec, rate) == ("s3dis_noisy", "pcgcv2", "r3")
    ]
    assert medians.loc[("s3dis_noisy", "pcgcv2", "r3"), "cd_plane"] == sorted(rows)[2]


def test_missing_values_do_not_count_in_medians_per_rate() -> None:
    table = pd.DataFrame(
        {"dataset": "a", "codec": "c", "rate": ["r1"] * 3, "cd_plane": [1.0, np.nan, 3.0]}
    )
    assert medians_per_rate(table, "cd_plane")["cd_plane"].tolist() == [2.0]


def test_rates_are_ordered_by_number() -> None:
    assert ordered_rates({"r10", "r2", "r1"}) == ["r1", "r2", "r10"]
    lengths = ["0.5mm", "2mm", "2.25mm", "2.5mm", "10mm"]
    assert ordered_rates(set(lengths)) == lengths

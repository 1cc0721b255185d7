"""Medians per bin and per rate against computations made without pandas' binning."""

import numpy as np
import pandas as pd
import pytest

from pointkit.seeding import generator
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
    np.testing.assert_allclose(np.transpose([curve.x, curve.y]), expected)
    quartiles = [
        np.quantile(y[bin_of == b], (0.25, 0.75)) if (bin_of == b).sum() >= 6 else [np.nan] * 2
        for b in range(10)
    ]
    np.testing.assert_allclose(np.transpose([curve.low, curve.high]), quartiles)
    assert np.ptp(np.bincount(bin_of)) <= 1


def test_fewer_distinct_values_than_bins_give_one_point_each() -> None:
    x = np.array([4.0, 1.0, 2.0, 2.0])
    bpp, values, *_ = equal_count_medians(x, 10 * x)
    assert bpp.tolist() == [1.0, 2.0, 4.0]
    assert values.tolist() == [10.0, 20.0, 40.0]


def test_one_distinct_value_is_one_bin() -> None:
    x, y, low, high, singles = equal_count_medians(np.full(6, 0.5), np.array([1.0, 5, 2, 1, 5, 2]))
    assert [values.tolist() for values in (x, y, low, high)] == [[0.5], [2.0], [1.25], [4.25]]
    assert len(singles) == 0


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
    for drawn, expected in zip(medians_against(rows, "bpp", "cd"), binned, strict=True):
        np.testing.assert_array_equal(drawn, expected)
    assert binned[0].tolist() == [1.0, 2.0, 4.0, 8.0]


@pytest.mark.parametrize("clouds", [2, 5, 6])
def test_quartiles_are_of_six_scenes_or_more_and_fewer_are_shown_singly(clouds: int) -> None:
    rows = _two_codes_of(clouds)
    for curve in (medians_against(rows, "bpp", "cd"), medians_per_rate(rows, "cd", ["r0", "r1"])):
        assert np.isfinite(curve.low).all() == np.isfinite(curve.high).all() == (clouds >= 6)
        assert len(curve.singles) == (0 if clouds >= 6 else len(curve.y) * clouds)


def test_clouds_of_one_scene_count_once() -> None:
    rows = _two_codes_of(8)
    of_two_rooms = rows.assign(scene=np.where(rows["cloud"] < "c4", "hall", "office"))
    assert np.isnan(medians_against(of_two_rooms, "bpp", "cd").low).all()
    assert np.isfinite(medians_against(rows, "bpp", "cd").low).all()


def test_a_single_cloud_has_a_line_and_no_dots() -> None:
    curve = medians_against(_two_codes_of(1), "bpp", "cd")
    assert (len(curve.y), len(curve.singles)) == (3, 0)


def test_medians_per_rate_are_those_of_the_rows() -> None:
    table = metrics_table(clouds=5).query("dataset == 's3dis_noisy' and codec == 'pcgcv2'")
    curve = medians_per_rate(table, "cd_plane", ["r2", "r3", "r9"])
    expected = sorted(table.loc[table["rate"] == "r3", "cd_plane"])[2]
    assert (curve.x[1], curve.y[1]) == (1.0, expected)
    assert np.isnan(curve.y[2])


def test_missing_values_do_not_count_in_medians_per_rate() -> None:
    table = pd.DataFrame({"cloud": list("abc"), "rate": "r1", "cd_plane": [1.0, np.nan, 3.0]})
    assert medians_per_rate(table, "cd_plane", ["r1"]).y.tolist() == [2.0]


def test_rates_are_ordered_by_number() -> None:
    assert ordered_rates({"r10", "r2", "r1"}) == ["r1", "r2", "r10"]
    lengths = ["0.5mm", "2mm", "2.25mm", "2.5mm", "10mm"]
    assert ordered_rates(set(lengths)) == lengths

"""BD-rates that sources print, computed again from their curves."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from puckbench.published_sources.bd_rates import (
    checked_bd_rates,
    polynomial_bd_rate,
    repeated_curves,
)
from puckbench.published_sources.registry import CUBIC, Source, source_named


@pytest.mark.parametrize("points", [4, 7])
def test_a_constant_ratio_of_bits_is_the_bd_rate(points: int) -> None:
    """ln bits is a cubic polynomial of the quality, which the fit reproduces exactly."""
    quality = np.linspace(30.0, 60.0, points)
    x = (quality - 45) / 15
    bits = np.exp(0.3 * x**3 - 0.2 * x**2 + 1.5 * x)
    assert polynomial_bd_rate(bits, quality, 0.8 * bits, quality) == pytest.approx(-20)


def test_the_mean_is_over_the_common_range() -> None:
    """Straight lines, ln bits = q / 10 and q / 10 + (q - 40) / 20, from 40 to 50 in common."""
    anchor, tested = np.linspace(30.0, 50.0, 5), np.linspace(40.0, 60.0, 5)
    found = polynomial_bd_rate(
        np.exp(anchor / 10), anchor, np.exp(tested / 10 + (tested - 40) / 20), tested
    )
    assert found == pytest.approx(100 * (np.exp(0.25) - 1))


@pytest.fixture(scope="module")
def checked() -> pd.DataFrame:
    return checked_bd_rates(source_named("sparsepcgc"))


def test_printed_bd_rates_come_out_again_to_the_digit(checked: pd.DataFrame) -> None:
    """SparsePCGC prints 70 BD-rates of people in a file, and 16 of LiDAR in notebooks."""
    assert len(checked) == 86
    different = checked[checked["difference"] != 0]
    keys = [*different[["cloud", "anchor", "measure"]].itertuples(index=False, name=None)]
    assert keys == []


def test_a_curve_that_two_clouds_share_is_told() -> None:
    """SparsePCGC gives ADL-PCC's curve of redandblack the numbers of longdress, and others."""
    rows = repeated_curves(source_named("sparsepcgc"))
    pairs = set(rows[["codec", "cloud", "same_as"]].itertuples(index=False, name=None))
    assert ("G-PCC trisoup", "loot_vox10_1200", "longdress_vox10_1300") in pairs
    assert ("ADL-PCC", "redandblack_vox10_1550", "longdress_vox10_1300") in pairs
    assert not any(codec in ("SparsePCGC", "G-PCC octree") for codec, _, _ in pairs)


def test_a_bd_rate_that_differs_shows_by_how_much() -> None:
    rows = source_named("sparsepcgc").rows
    is_it = rows["measure"].eq("bd_rate_d1") & rows["cloud"].eq("longdress_vox10_1300")
    place = rows.index[is_it & rows["anchor"].eq("PCGCv2")]
    changed = rows.assign(value=rows["value"].where(~rows.index.isin(place), -47.5))
    other = Source("other", lambda: changed, "Other", "here", "none", CUBIC)
    found = checked_bd_rates(other)
    (row,) = found[found["difference"] != 0].to_dict("records")
    assert (row["printed"], row["difference"]) == (-47.5, 0.3)
    assert row["again"] == pytest.approx(-47.2, abs=0.05)


def test_a_bd_rate_without_its_curve_is_told() -> None:
    rows = source_named("sparsepcgc").rows
    other = Source(
        "other", lambda: rows[rows["codec"] != "ADL-PCC"], "Other", "here", "none", CUBIC
    )
    found = checked_bd_rates(other)
    without = found[found["again"].isna()]
    assert set(without["anchor"]) == {"ADL-PCC"}
    assert set(without["status"]) == {"no such curve in the source"}
    assert len(without) == 14


def test_a_claim_that_its_curves_do_not_give_has_the_difference_beside_it() -> None:
    """RENO's abstract prints -12.25 % and -48.34 %, and its repository the curves of one set."""
    against_gpcc, against_draco = checked_bd_rates(source_named("reno")).to_dict("records")
    assert (against_gpcc["printed"], against_gpcc["difference"]) == (-12.25, -1.13)
    assert against_gpcc["again"] == against_gpcc["pchip"] == pytest.approx(-13.38, abs=0.005)
    assert np.isnan(against_draco["again"])
    assert against_draco["status"] == "no such curve in the source"

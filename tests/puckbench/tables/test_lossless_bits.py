"""Bits without loss against bits without loss."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from puckbench.tables.lossless_bits import lossless_bits


def _row(codec: str, cloud: int, rate: str, bpp: float, **more: object) -> dict[str, object]:
    return {
        "dataset": "d",
        "cloud": f"c{cloud}",
        "codec": codec,
        "rate": rate,
        "bpp": bpp,
        "points_in": 100,
        "points_out": 100,
        "lossless": True,
        "d1_psnr": np.nan,
        **more,
    }


def _rows(ratios: list[float]) -> pd.DataFrame:
    """A run in which codec `b` needs `ratios` times the 8, 16, 24, ... bits of `a`."""
    rows = []
    for n, ratio in enumerate(ratios):
        rows += [_row("a", n, "r2", 8.0 * (n + 1)), _row("a", n, "r3", 99.0)]
        rows.append(_row("b", n, "r1", 8.0 * (n + 1) * ratio))
        rows.append(_row("b", n, "r0", 0.1, lossless=False, d1_psnr=60.0))
        rows.append(_row("c", n, "r1", 0.1, points_out=99))  # not all points come back
    return pd.DataFrame(rows)


def test_the_ratio_of_bits_without_loss_is_a_geometric_mean_with_an_interval() -> None:
    ratios = [0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
    table = lossless_bits(_rows(ratios), "a").set_index("codec")
    assert list(table.index) == ["b", "a"]  # fewest bits first; `c` is never lossless
    logs = np.log(ratios)
    low, high = stats.t.interval(0.95, 5, logs.mean(), stats.sem(logs))
    expected = 100 * np.expm1([logs.mean(), low, high, logs.min(), logs.max()])
    row = table.loc["b"]
    names = [f"lossless_percent{end}" for end in ("", "_low", "_high", "_least", "_most")]
    assert row[names].tolist() == pytest.approx(expected.tolist())
    assert (row["anchor"], row["verdict"], row["scenes"], row["clouds"]) == ("a", "better", 6, 6)
    bits_of_a = stats.gmean([8.0 * n for n in range(1, 7)])
    assert table.loc["a", "bpp"] == pytest.approx(bits_of_a)
    assert np.isnan(table.loc["a", "lossless_percent"])


def test_lossy_rates_do_not_count_however_few_their_bits() -> None:
    table = lossless_bits(_rows([0.5]), "a").set_index("codec")
    assert table.loc["b", "lossless_percent"] == pytest.approx(-50)
    assert table.loc["b", "verdict"] == "no verdict"
    assert np.isnan(table.loc["b", "lossless_percent_low"])


def test_an_anchor_that_loses_points_gives_way_to_the_lossless_octree() -> None:
    rows = _rows([0.5] * 6)
    octree = [_row("gpcc_lossless", n, "r1", 4.0 * (n + 1)) for n in range(6)]
    table = lossless_bits(pd.concat([rows, pd.DataFrame(octree)]), "c").set_index("codec")
    assert set(table["anchor"]) == {"gpcc_lossless"}
    assert table.loc["a", "lossless_percent"] == pytest.approx(100)
    assert lossless_bits(rows, "c")["anchor"].tolist() == ["a", "a"]


def test_seeds_of_one_scene_are_one_sample() -> None:
    rows = _rows([0.5, 2.0, 0.5, 2.0])
    scenes = rows["cloud"].map({"c0": "s", "c1": "s", "c2": "t", "c3": "t"})
    row = lossless_bits(rows.assign(scene=scenes), "a").set_index("codec").loc["b"]
    assert (row["scenes"], row["clouds"]) == (2, 4)
    assert row["lossless_percent_least"] == pytest.approx(0, abs=1e-9)


def test_attributes_do_not_count_where_their_bits_are_known() -> None:
    rows = _rows([0.5])
    rows.loc[rows["codec"] == "b", "bpp_geometry"] = 2.0
    row = lossless_bits(rows, "a").set_index("codec").loc["b"]
    assert row["bpp"] == pytest.approx(2)
    assert row["lossless_percent"] == pytest.approx(-75)


def test_a_run_without_lossless_rates_has_an_empty_table() -> None:
    rows = _rows([0.5])
    table = lossless_bits(rows.assign(lossless=False), "a")
    assert table.empty
    assert "lossless_percent" in table

"""Medians over clouds, and their spread."""

from __future__ import annotations

import pytest

from puckbench.results.rows import METRIC_KEYS, table_of
from puckbench.tables.summary import summary


def _row(cloud: str, rate: str, bpp: float) -> dict:
    return {"rate": rate, "cloud": cloud, "bpp": bpp, "codec": "draco", "dataset": "d", "zeta": 1}


def test_the_summary_has_medians_over_clouds() -> None:
    rows = [
        _row(cloud, rate, bpp)
        for cloud, rate, bpp in [
            ("a", "r1", 1.0),
            ("b", "r1", 5.0),
            ("c", "r1", 2.0),
            ("a", "r2", 9.0),
        ]
    ]
    result = summary(table_of(rows, METRIC_KEYS))
    assert result.bpp.tolist() == [2.0, 9.0]
    assert result.clouds.tolist() == [3, 1]


def test_the_summary_says_which_weights_were_used() -> None:
    rows = [{**_row(cloud, "r1", 1.0), "weights": "mine 0a1b"} for cloud in ("a", "b")]
    result = summary(table_of([*rows, {**_row("a", "r1", 1.0), "codec": "plain"}], METRIC_KEYS))
    assert result.weights.fillna("").tolist() == ["mine 0a1b", ""]


def test_the_summary_has_the_spread_over_clouds() -> None:
    rows = [_row(f"c{i}", "r1", float(i)) for i in range(101)]
    result = summary(table_of(rows, METRIC_KEYS)).iloc[0]
    assert result[["bpp_q25", "bpp", "bpp_q75"]].tolist() == [25, 50, 75]
    assert not {"bpp_q05", "bpp_q95"} & set(result.index)


def test_fewer_than_six_clouds_have_no_quartiles() -> None:
    rows = [_row(f"c{i}", rate, float(i)) for rate, n in (("r1", 5), ("r2", 6)) for i in range(n)]
    result = summary(table_of(rows, METRIC_KEYS))
    assert result.bpp.tolist() == [2, 2.5]
    assert result.bpp_q25.isna().tolist() == [True, False]
    assert result.bpp_q75.isna().tolist() == [True, False]


def test_the_summary_counts_lossless_clouds_as_the_best_and_names_the_peak() -> None:
    psnrs = {"r1": [60.0, 61.0, 62.0], "r2": [70.0, 71.0, None], "r3": [80.0, None, None]}
    rows = [
        {**_row(f"c{n}", rate, 1.0), "peak": 30.0, "lossless": psnr is None}
        | ({} if psnr is None else {"d1_psnr": psnr})
        for rate, values in psnrs.items()
        for n, psnr in enumerate(values)
    ]
    result = summary(table_of(rows, METRIC_KEYS))
    assert result.d1_psnr.tolist()[:2] == [61, 71]
    assert result.d1_psnr.isna().tolist() == [False, False, True]
    assert result.lossless.tolist() == [0, 1, 2]
    assert result.peak.tolist() == [30] * 3


def test_psnrs_of_several_peaks_have_no_median(caplog: pytest.LogCaptureFixture) -> None:
    rows = [
        {**_row(c, "r1", 1.0), "d1_psnr": 60.0, "peak": p} for c, p in (("a", 1023), ("b", 511))
    ]
    result = summary(table_of(rows, METRIC_KEYS))
    assert result.d1_psnr.isna().all()
    assert caplog.messages == ["PSNRs of d have several peaks: medians over clouds are left out"]

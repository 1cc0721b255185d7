import json
from pathlib import Path

import pandas as pd
import pytest

from pointkit.errors import InputError
from pointkit.tables import write_table
from puckbench.results.curves import write_rows
from puckbench.steps.tables.results import (
    CLOUD_KEYS,
    METRIC_KEYS,
    RECOVERY_KEYS,
    cloud_row,
    recovery_rows,
    scan_error_rows,
    summary,
    table_of,
)


def _row(cloud: str, rate: str, bpp: float) -> dict:
    return {"rate": rate, "cloud": cloud, "bpp": bpp, "codec": "draco", "dataset": "d", "zeta": 1}


def test_columns_and_rows_have_a_fixed_order() -> None:
    table = table_of([_row("b", "r1", 1.0), _row("a", "r1", 2.0)], METRIC_KEYS)
    assert list(table) == ["dataset", "cloud", "codec", "rate", "bpp", "zeta"]
    assert list(table.cloud) == ["b", "a"]


def test_a_result_given_twice_is_refused() -> None:
    with pytest.raises(InputError, match="same dataset, cloud, codec, rate"):
        table_of([_row("a", "r1", 1.0), _row("a", "r1", 1.0)], METRIC_KEYS)


def test_no_results_make_no_table() -> None:
    with pytest.raises(InputError, match="no results"):
        table_of([], METRIC_KEYS)


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


def test_csv_and_parquet_hold_the_same(tmp_path: Path) -> None:
    table = table_of([_row("a", "r1", 0.1), _row("b", "r1", 1e-17)], METRIC_KEYS)
    write_table(table, tmp_path / "t.csv", tmp_path / "t.parquet")
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "t.csv"), table, check_dtype=False)
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "t.parquet"), table, check_dtype=False)


def test_a_clouds_row_comes_from_its_description(tmp_path: Path) -> None:
    about = {
        "name": "room",
        "group": "office",
        "points": 10,
        "elongation": 0.5,
        "diameter": 9.0,
        "scale": 100.0,
        "size_m": [1.0, 2.0, 3.0],
        "seed": 4,
    }
    (tmp_path / "room.json").write_text(json.dumps(about))
    row = cloud_row("raw", tmp_path / "room.json")
    assert row["size_y_m"] == 2.0
    assert list(table_of([row], CLOUD_KEYS).columns[:2]) == ["dataset", "cloud"]


def test_counts_stay_whole_where_some_rows_have_none(tmp_path: Path) -> None:
    rows = [{**_row("a", "r1", 1.0), "truth_points_a": 7}, _row("b", "r1", 2.0)]
    write_table(table_of(rows, METRIC_KEYS), tmp_path / "t.csv", tmp_path / "t.parquet")
    assert (tmp_path / "t.csv").read_text().splitlines()[1].endswith(",7,1")


def test_of_a_scan_measured_as_decoded_only_its_distance_to_the_truth_is_kept(
    tmp_path: Path,
) -> None:
    row = {
        "dataset": "d",
        "cloud": "a",
        "cd_plane": 0.0,
        "truth_cd_plane": 3.0,
        "clean_d1_rms_m": 1,
    }
    (tmp_path / "a.json").write_text(json.dumps(row))
    (result,) = scan_error_rows([tmp_path / "a.json"])
    assert result == {"dataset": "d", "cloud": "a", "truth_cd_plane": 3.0, "clean_d1_rms_m": 1}


def test_recovered_primitives_have_a_row_for_each_kind_and_one_where_there_are_none(
    tmp_path: Path,
) -> None:
    kinds = [{"kind": "all", "found": 3, "recall": 0.5}, {"kind": "plane", "found": 3}]
    for rate, result in (("r1", kinds), ("r8", [{"kind": "all"}])):
        rows = [{**_row("a", rate, 1.0), **kind} for kind in result]
        write_rows(tmp_path / f"{rate}.parquet", rows)
    rows = recovery_rows([tmp_path / "r1.parquet", tmp_path / "r8.parquet"])
    table = table_of(rows, RECOVERY_KEYS)
    assert table.kind.tolist() == ["all", "plane", "all"]
    assert table.rate.tolist() == ["r1", "r1", "r8"]
    assert table.found.tolist()[:2] == [3, 3]
    assert table.found.isna().tolist() == [False, False, True]
    assert list(table)[:5] == ["dataset", "cloud", "codec", "rate", "kind"]


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

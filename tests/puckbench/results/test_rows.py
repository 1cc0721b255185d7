import json
from pathlib import Path

import pandas as pd
import pytest

from pointkit.errors import InputError
from pointkit.tables import write_table
from puckbench.results.row_files import write_rows
from puckbench.results.rows import CLOUD_KEYS, METRIC_KEYS, cloud_row, scan_error_row, table_of
from puckbench.tables.gathered import recovery


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
    result = scan_error_row(tmp_path / "a.json")
    assert result == {"dataset": "d", "cloud": "a", "truth_cd_plane": 3.0, "clean_d1_rms_m": 1}


def test_recovered_primitives_have_a_row_for_each_kind_and_one_where_there_are_none(
    tmp_path: Path,
) -> None:
    kinds = [{"kind": "all", "found": 3, "recall": 0.5}, {"kind": "plane", "found": 3}]
    for rate, result in (("r1", kinds), ("r8", [{"kind": "all"}])):
        rows = [{**_row("a", rate, 1.0), **kind} for kind in result]
        write_rows(tmp_path / f"{rate}.parquet", rows)
    table = recovery([tmp_path / "r1.parquet", tmp_path / "r8.parquet"])
    assert table.kind.tolist() == ["all", "plane", "all"]
    assert table.rate.tolist() == ["r1", "r1", "r8"]
    assert table.found.tolist()[:2] == [3, 3]
    assert table.found.isna().tolist() == [False, False, True]
    assert list(table)[:5] == ["dataset", "cloud", "codec", "rate", "kind"]

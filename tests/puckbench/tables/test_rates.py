"""Bits, errors and times of all clouds together, at each rate."""

import numpy as np
import pandas as pd
import pytest

from puckbench.tables.rates import rates


def _rows() -> pd.DataFrame:
    columns = ["dataset", "codec", "rate", "bytes", "file_bytes", "bpp", "d1_rms_m", "q99_point_m"]
    rows = [
        ("site", "draco", "r1", 100, 1000, 2.0, 0.003, 0.01),
        ("site", "draco", "r1", 300, 3000, 4.0, 0.004, 0.02),
        ("site", "draco", "r2", 200, 1000, 6.0, 0.001, 0.002),
        ("objects", "draco", "r1", 50, np.nan, 1.0, 0.5, 1.0),
    ]
    table = pd.DataFrame(rows, columns=columns)
    return table.assign(
        points_in=[1000, 3000, 1000, 500],
        d2_rms_m=table["d1_rms_m"] / 2,
        truth_d2_rms_m=table["d1_rms_m"] * 2,
        hausdorff_point_m=3 * table["q99_point_m"],
        range_rms_mm=[6.0, 8.0, 1.0, np.nan],
        encode_s=0.25,
        decode_s=0.5,
    )


def test_means_errors_and_times_of_a_rate() -> None:
    row = rates(_rows()).set_index(["dataset", "rate"]).loc["site", "r1"]
    assert (row["clouds"], row["bpp"], row["file_ratio"]) == (2, 3, 10)
    rms = np.sqrt((3**2 + 4**2) / 2)
    errors = row[["d1_rms_mm", "d2_rms_mm", "truth_d2_rms_mm", "range_rms_mm"]].tolist()
    assert errors == pytest.approx([rms, rms / 2, 2 * rms, 2 * rms])
    assert row[["q99_mm", "largest_mm"]].tolist() == pytest.approx([20, 60])  # the worst cloud's
    # 0.5 and 1 s for 4000 points
    assert row[["encode_s", "decode_s"]].tolist() == pytest.approx([125, 250])


def test_what_does_not_apply_is_empty_or_left_out() -> None:
    table = rates(_rows()).set_index(["dataset", "rate"])
    assert table.loc[("objects", "r1"), ["file_ratio", "range_rms_mm"]].isna().all()
    assert "file_ratio" not in rates(_rows().assign(file_bytes=np.nan))
    bare = _rows()[["dataset", "codec", "rate", "bytes", "bpp", "points_in"]]
    assert list(rates(bare)) == ["dataset", "codec", "rate", "clouds", "bpp"]


def test_a_rate_that_was_not_timed_on_every_cloud_has_no_time() -> None:
    rows = _rows()
    rows.loc[0, "encode_s"] = np.nan
    row = rates(rows).set_index(["dataset", "rate"]).loc["site", "r1"]
    assert np.isnan(row["encode_s"])
    assert row["decode_s"] == pytest.approx(250)


def test_the_ratio_to_the_files_has_what_of_them_is_in_the_streams() -> None:
    rows = _rows().assign(
        file_attributes=["normals, colours", "intensity", None, None],
        not_coded=["normals", "intensity", None, None],
        dropped_points=[2, 1, np.nan, np.nan],
    )
    table = rates(rows).set_index(["dataset", "rate"])
    of_files = table[["coded", "not_coded"]]
    assert of_files.loc["site", "r1"].tolist() == [
        "positions, colours",
        "normals, intensity, 3 points",
    ]
    assert of_files.loc[("site", "r2"), "coded"] == "positions"
    assert pd.isna(of_files.loc[("site", "r2"), "not_coded"])
    assert of_files.loc["objects", "r1"].isna().all()  # made of no file
    assert "not_coded" not in rates(_rows())

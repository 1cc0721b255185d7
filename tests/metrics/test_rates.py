"""Bytes, errors and times of all clouds together, at each rate."""

import numpy as np
import pandas as pd

from puckbench.metrics.tables.rates import rates


def _rows() -> pd.DataFrame:
    columns = ["dataset", "codec", "rate", "bytes", "file_bytes", "d1_rms_m", "hausdorff_point_m"]
    rows = [
        ("site", "draco", "r1", 100, 1000, 0.003, 0.01),
        ("site", "draco", "r1", 300, 3000, 0.004, 0.02),
        ("site", "draco", "r2", 200, 1000, 0.001, 0.002),
        ("objects", "draco", "r1", 50, np.nan, 0.5, 1.0),
    ]
    return pd.DataFrame(rows, columns=columns).assign(encode_s=0.25, decode_s=0.5)


def test_sums_ratios_and_errors_of_a_rate() -> None:
    table = rates(_rows()).set_index(["dataset", "rate"])
    row = table.loc["site", "r1"]
    assert (row["clouds"], row["bytes"], row["ratio"]) == (2, 400, 10)
    assert np.isclose(row["rms_mm"], 1000 * np.sqrt((0.003**2 + 0.004**2) / 2))
    assert row["largest_mm"] == 20
    assert (row["encode_s"], row["decode_s"]) == (0.5, 1.0)


def test_clouds_that_are_not_files_have_no_ratio() -> None:
    table = rates(_rows()).set_index(["dataset", "rate"])
    assert np.isnan(table.loc[("objects", "r1"), "ratio"])
    assert rates(_rows().drop(columns="file_bytes"))["ratio"].isna().all()

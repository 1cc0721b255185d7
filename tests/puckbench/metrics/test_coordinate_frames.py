"""Rows of tables by the frame of their clouds."""

import pandas as pd

from puckbench.metrics.coordinate_frames import rows_in_frame


def test_rows_are_told_apart_by_their_frame_and_empty_columns_of_metres_are_left_out() -> None:
    table = pd.DataFrame(
        {"frame": [None, "metric", None], "d1_psnr": [60.0, None, 50.0], "rms_m": [1.0, 2.0, 3.0]}
    )
    assert rows_in_frame(table, "scaled")["rms_m"].tolist() == [1.0, 3.0]
    rows = rows_in_frame(table, "metric")
    assert rows["rms_m"].tolist() == [2.0]
    assert list(rows) == ["frame", "rms_m"]


def test_a_table_without_frames_is_of_scaled_clouds() -> None:
    table = pd.DataFrame({"rms_m": [1.0, 2.0]})
    assert rows_in_frame(table, "scaled") is table
    assert rows_in_frame(table, "metric").empty

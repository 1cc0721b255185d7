"""The dictionary of columns beside a table."""

from __future__ import annotations

import numpy as np
import pandas as pd

from puckbench.metrics.metric_registry import METRICS
from puckbench.report.reference_results import read_reference
from puckbench.tables.column_dictionary import column_dictionary


def test_a_dictionary_has_meaning_unit_and_the_reason_of_missing_values() -> None:
    metrics = read_reference("default").metrics
    rows = column_dictionary(metrics).set_index("column")
    assert list(rows.index) == list(metrics)
    assert rows.loc["cd_plane", ["meaning", "unit", "missing", "reason"]].tolist() == [
        "Chamfer distance, point to plane", "grid units² or m²", 0, "",
    ]  # fmt: skip
    assert rows["missing"].to_dict() == metrics.isna().sum().to_dict()
    missing = rows[rows["missing"] > 0]
    assert (missing["reason"] != "").all()
    assert missing.loc["truth_d1_mse", "reason"] == "the true surface is not known"
    assert missing.loc["range_rms_mm", "reason"] == "no returns of a sensor"


def test_an_optional_metric_says_what_its_columns_mean() -> None:
    METRICS.register("test_tilt", columns={"tilt_deg": "Tilt of the cloud"})(lambda *_: {})
    (row,) = column_dictionary(pd.DataFrame({"tilt_deg": [1.0, np.nan]})).to_dict("records")
    assert row == {
        "column": "tilt_deg", "meaning": "Tilt of the cloud", "unit": "°", "missing": 1,
        "reason": "does not apply",
    }  # fmt: skip

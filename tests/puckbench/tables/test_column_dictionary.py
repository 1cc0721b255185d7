"""The dictionary of columns beside a table, and tables as LaTeX."""

from __future__ import annotations

import numpy as np
import pandas as pd

from puckbench.metrics.metric_registry import METRICS
from puckbench.report.reference_results import read_reference
from puckbench.tables.column_dictionary import column_dictionary
from puckbench.tables.latex import latex_table


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


def test_a_table_in_latex_has_units_dashes_and_no_special_characters() -> None:
    table = pd.DataFrame(
        {
            "codec": ["gpcc_angular", "50 % & more"],
            "bd_rate_percent": [-12.34567, np.nan],
            "cd_plane": [0.5, 20000.4],
            "empty": [np.nan, np.nan],
        }
    )
    assert latex_table(table).splitlines() == [
        r"\begin{tabular}{lrr}",
        r"\toprule",
        r"Codec & BD-rate (\%) & Chamfer distance, point to plane "
        r"(grid units\textsuperscript{2}) \\",
        r"\midrule",
        r"gpcc\_angular & -12.3 & 0.5 \\",
        r"50 \% \& more & -- & 20000 \\",
        r"\bottomrule",
        r"\end{tabular}",
    ]


def test_in_latex_intervals_stand_beside_values_with_the_digits_they_allow() -> None:
    table = pd.DataFrame(
        {
            "codec": ["a", "b", "c", "d"],
            "bd_rate_percent": [-53.628, -12.3456, 118.4, 5.4321],
            "bd_rate_percent_low": [-60.21, -12.41, 50.2, np.nan],
            "bd_rate_percent_high": [-46.93, -12.28, 190.1, np.nan],
            "scenes": 6,
        }
    )
    head, *rows = [line for line in latex_table(table).splitlines() if "&" in line]
    assert head == r"Codec & BD-rate (\%) & Scenes \\"
    assert rows == [
        r"a & -54 (-60 to -47) & 6 \\",  # 13 wide: whole numbers
        r"b & -12.35 (-12.41 to -12.28) & 6 \\",  # 0.13 wide: hundredths
        r"c & 118 (50 to 190) & 6 \\",
        r"d & 5.43 & 6 \\",
    ]


def test_latex_tables_have_twelve_columns_at_most() -> None:
    table = pd.DataFrame({f"c{n:02}": [float(n)] for n in range(14)})
    table.insert(1, "c00_low", [-1.0])
    table.insert(2, "c00_high", [1.0])
    (head, row) = [line for line in latex_table(table).splitlines() if "&" in line]
    assert head.count("&") == row.count("&") == 11
    assert row.startswith("0.0 (-1.0 to 1.0) & 1 & 2")

"""Tables of results as LaTeX: columns, digits, intervals and notes, as written by hand."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest

from pointkit.errors import InputError
from puckbench.report.reference_results import read_reference
from puckbench.tables.cells import decimals_of
from puckbench.tables.latex import MOST_COLUMNS, latex_table, paper_columns
from puckbench.tables.rate_deltas import bd_rate
from puckbench.tables.registry import table_entries


def _body(text: str) -> tuple[str, list[str]]:
    head, *rows = [line for line in text.splitlines() if "&" in line]
    return head, rows


def test_a_table_has_units_dashes_and_no_special_characters() -> None:
    table = pd.DataFrame(
        {
            "codec": ["gpcc_angular", "50 % & more"],
            "bd_rate_percent": [-12.34567, np.nan],
            "cd_plane": [0.5, 20000.4],
            "d2_mse": [1.25e-7, -3.0],
            "empty": [np.nan, np.nan],
        }
    )
    assert latex_table(table).splitlines() == [
        r"\begin{tabular}{lrrr}",
        r"\toprule",
        r"Codec & BD-rate (\%) & CD, point-to-plane (grid units\textsuperscript{2})"
        r" & D2 MSE (grid units\textsuperscript{2}) \\",
        r"\midrule",
        r"gpcc\_angular & $-12.3$ & 0.5 & $1.25 \times 10^{-7}$ \\",
        r"50 \% \& more & -- & 20000 & $-3$ \\",
        r"\bottomrule",
        r"\end{tabular}",
    ]


@pytest.mark.parametrize(
    ("half", "decimals"),
    [(6.5, 1), (0.065, 3), (0.0996, 2), (9.94, 1), (9.96, 0), (70, 0), (99.6, -1), (1234, -2)],
)
def test_half_the_interval_has_two_digits(half: float, decimals: int) -> None:
    """±6.5, ±0.065, ±0.10, ±9.9, ±10, ±70, ±100 and ±1200."""
    assert decimals_of(half) == decimals


def test_an_interval_decides_the_digits_of_its_value() -> None:
    table = pd.DataFrame(
        {
            "codec": list("abcdef"),
            "bd_rate_percent": [-53.628, -12.3456, 118.4, 5.4321, 23456.0, -0.004],
            "bd_rate_percent_low": [-60.21, -12.41, 50.2, np.nan, 22222.0, -0.07],
            "bd_rate_percent_high": [-46.93, -12.28, 190.1, np.nan, 24690.0, 0.06],
            "scenes": [6, 7, 6, 5, 16, 6],
        }
    )
    text = latex_table(table)
    head, rows = _body(text)
    assert head == r"Codec & BD-rate (\%) & Scenes \\"
    assert rows == [
        r"a & $-53.6\ [-60.2, -46.9]$ & 6 \\",  # ±6.6
        r"b & $-12.346\ [-12.410, -12.280]$ & 7 \\",  # ±0.065
        r"c & $118\ [50, 190]$ & 6 \\",  # ±70
        r"d & 5.4 & 5 \\",  # no interval: the decimals of the column
        r"e & $23500\ [22200, 24700]$ & 16 \\",  # ±1200
        r"f & $-0.004\ [-0.070, 0.060]$ & 6 \\",  # ±0.065
    ]
    note = text.split(r"\end{tabular}")[1].strip()
    assert note == (
        r"{\footnotesize\raggedright In brackets: 95 \% interval over scenes (n = 5 to 16). "
        r"There is none below n = 6.\par}"
    )


def test_what_rounds_to_zero_has_no_sign() -> None:
    table = pd.DataFrame({"codec": ["a"], "bd_quality_db": [-0.001]})
    assert _body(latex_table(table))[1] == [r"a & 0.00 \\"]


def test_titles_of_codecs_and_short_names_of_metrics_are_shown() -> None:
    table = pd.DataFrame({"codec": ["a_b"], "metric": ["d1_psnr"], "anchor": ["c"], "clouds": [4]})
    text = latex_table(table, titles={"a_b": "A, β"})
    assert _body(text)[1] == [r"A, β & D1 PSNR & c \\"]
    assert r"n = 4 clouds." in text  # `clouds` is no column of its own


def test_the_interval_of_a_difference_is_in_columns_of_their_own() -> None:
    columns = {"codec": ["a"], "difference": [0.5], "low": [0.1], "high": [0.9]}
    text = latex_table(pd.DataFrame({**columns, "trajectories": 8}))
    assert _body(text)[1] == [r"a & $0.50\ [0.10, 0.90]$ & 8 \\"]
    assert "over trajectories (n = 8)" in text


def test_a_paper_has_eight_columns_and_those_that_one_names() -> None:
    table = pd.DataFrame({f"c{n:02}": [float(n)] for n in range(14)})
    table.insert(1, "c00_low", [-1.0])
    table.insert(2, "c00_high", [1.0])
    columns = paper_columns(table)
    assert columns == [f"c{n:02}" for n in range(8)]
    head, (row,) = _body(latex_table(table, columns))
    assert head.count("&") == row.count("&") == MOST_COLUMNS - 1
    assert row.startswith(r"$0.0\ [-1.0, 1.0]$ & 1 & 2")
    assert paper_columns(table, usual=("c09", "none", "c03")) == ["c09", "c03"]
    assert paper_columns(table, ["c13", "c00"]) == ["c13", "c00"]


@pytest.mark.parametrize(
    ("wanted", "fault"),
    [
        (["codex"], "no column 'codex'; did you mean 'codec'?"),
        (["xyz"], "no column 'xyz' (known: codec, bpp)"),
        (["bpp", "bpp"], "column 'bpp' is named twice"),
        (["codec", *map(str, range(8))], "9 columns, but a page has space for 8"),
    ],
)
def test_other_columns_are_refused_in_a_line(wanted: list[str], fault: str) -> None:
    table = pd.DataFrame({"codec": ["a"], "bpp": [1.0]})
    if len(wanted) > MOST_COLUMNS:
        table = table.assign(**dict.fromkeys(wanted[1:], 1.0))
    with pytest.raises(InputError, match=f"^{re.escape(fault)}$"):
        paper_columns(table, wanted)


def test_a_table_of_results_is_whole_latex() -> None:
    """Braces and dollars are balanced, and each row has as many cells as the head has."""
    table = bd_rate(read_reference("default").metrics, "gpcc")
    text = latex_table(table, paper_columns(table, usual=table_entries()["bd_rate"].shown))
    head, rows = _body(text)
    assert head.count("&") == MOST_COLUMNS - 1
    assert {line.count("&") for line in rows} == {head.count("&")}
    assert all(line.endswith(r" \\") and line.count("$") % 2 == 0 for line in [head, *rows])
    assert text.count("{") == text.count("}")
    assert re.findall(r"\\(?:begin|end)\{(\w+)\}", text) == ["tabular"] * 2
    assert not re.search(r"(?<!\\)[%#_]", text.replace("\\%", ""))


def test_tables_show_columns_that_exist_and_fit() -> None:
    for name, entry in table_entries().items():
        assert len(entry.shown) <= MOST_COLUMNS, name
        assert len(set(entry.shown)) == len(entry.shown), name

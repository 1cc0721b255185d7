"""Differences of tables, apart from times, memory and the machine."""

from __future__ import annotations

import pytest

from puckbench.results.sameness import table_difference

TABLE = """cloud,bpp,d1_psnr,encode_s,encode_peak_mib,cpu,verdict
a,1.5,40.0,1,100,x,better
b,2.5,,1,1,x,
"""


def difference(second: str, timed: dict[str, list[str]] | None = None, first: str = TABLE) -> str:
    return table_difference(first.encode(), second.encode(), timed or {})


def test_times_memory_and_processor_do_not_count() -> None:
    assert difference(TABLE.replace("1,100,x", "7,300,y")) == ""


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("1.5", "1.2", "bpp in 1 of 2 rows (by at most 0.2 of the value)"),
        ("40.0", "", "d1_psnr in 1 of 2 rows"),
        ("better", "worse", "verdict in 1 of 2 rows"),
        (
            "a,1.5",
            "c,3.0",
            "cloud in 1 of 2 rows, bpp in 1 of 2 rows (by at most 0.5 of the value)",
        ),
        ("b,2.5,,1,1,x,\n", "", "2 and 1 rows"),
        ("bpp", "bits", "other columns: bpp, bits"),
        ("cloud,bpp", "bpp,cloud", "another order of the columns"),
    ],
)
def test_what_differs_is_told(old: str, new: str, expected: str) -> None:
    assert difference(TABLE.replace(old, new, 1)) == expected


def test_rows_and_columns_that_depend_on_times_do_not_count() -> None:
    first = "use,codec,seconds\nmap,a,1\nreal_time,b,1\n"
    second = "use,codec,seconds\nmap,a,2\n"
    assert difference(second, {"seconds": [], "use": ["real_time"]}, first) == ""
    assert difference(second, {"seconds": []}, first) == "2 and 1 rows"


def test_cut_and_empty_tables_are_compared() -> None:
    assert difference("") == "other columns: cloud, bpp, d1_psnr, verdict"
    assert difference(TABLE.removesuffix("5,,1,1,x,\n")).startswith("bpp in 1 of 2 rows")

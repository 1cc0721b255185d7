"""The section of the report with published numbers."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pointkit.tables import read_table, write_table
from puckbench.report.sections import SectionData, sections_of
from puckbench.tables.published import published
from puckbench.tables.registry import table_entry
from tests.support.reference_lookalike import CLOUDS, MINE, clouds_of, rows_of


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_the_section_has_conditions_side_by_side_and_marks(suffix: str, tmp_path: Path) -> None:
    metrics = rows_of("mine", MINE).assign(frame="metric")
    metrics["peak"] = 30.0
    table = published(metrics, clouds_of(CLOUDS), {"objects": "KITTI"})
    write_table(table, path := tmp_path / f"published{suffix}")
    tables = {"published": read_table(path)}
    (section,) = (each for each in sections_of(tables) if each.name == "published")
    html = str(section.make(SectionData(tables, {"published": "tables/published.csv"}, {})))
    assert 'href="tables/published.csv"' in html
    assert "objects beside KITTI: D1 PSNR (dB)" in html
    rows = re.findall(r"<tr>(<td>.*?)</tr>", html)
    texts = [re.findall("<td>(.*?)</td>", row) for row in rows]
    own = [row for row in texts if row[1] == "this run"]
    assert len(own) == 4  # D1, D2, and both times
    assert own[0][5:9] == ["30 m", "8,000", "4", "metres, as recorded"]
    theirs = [row for row in texts if row[0] == "G-PCC octree, TMC13 v21" and "less" in row[4]]
    assert theirs[0][5:9] == ["30 m", "119,389", "not stated", "1 mm"]
    assert all(row[-1].startswith("[") for row in texts if row[1] != "this run")
    told = (
        "points 119,389 (here 8,000); frames not stated (here 4); coordinates 1 mm (here metres, "
    )
    assert f"<dt>{theirs[0][-1]}</dt><dd>{told}as recorded)</dd>" in html


def test_the_table_says_what_its_columns_are() -> None:
    entry = table_entry("published")
    assert entry.inputs == ("metrics", "clouds")
    assert "differs" in entry.caption

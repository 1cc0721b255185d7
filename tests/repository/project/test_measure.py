"""`make measure`: rows, their aims, and the file that keeps them."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from benchmarks.performance.measure import RESULTS, file_text
from benchmarks.performance.rows import Row

from tests.support.pages import ROOT


@pytest.mark.parametrize(
    ("row", "ratio", "is_met"),
    [
        (Row("a", 3.0, "s", "rival", 4.0, at_most=0.75), 0.75, True),
        (Row("a", 3.1, "s", "rival", 4.0, at_most=0.75), 0.775, False),
        (Row("a", 9.0, "x real time", at_least=10), None, False),
        (Row("a", 9.0, "s", at_most=10, at_least=8), None, True),
        (Row("a", 9.0, "s", "rival", 3.0), 3.0, None),
    ],
)
def test_the_aim_is_of_the_ratio_or_without_a_rival_of_the_value(
    row: Row, ratio: float | None, is_met: bool | None
) -> None:
    assert (row.ratio, row.is_met) == (ratio, is_met)


def test_the_file_has_a_line_for_each_row() -> None:
    text = RESULTS.read_text(encoding="utf-8")
    subjects = json.loads(text)
    assert file_text(subjects) == text
    rows = [row for subject in subjects.values() for row in subject["rows"]]
    assert [json.loads(line.strip(" ,")) for line in text.splitlines() if '"what"' in line] == rows


def test_a_subject_without_its_program_keeps_its_rows(tmp_path: Path) -> None:
    results = tmp_path / "performance.json"
    before = {"metrics": {"commit": "older", "rows": [{"what": "a", "value": 1, "unit": "s"}]}}
    results.write_text(text := file_text(before))
    command = [sys.executable, "-m", "benchmarks.performance.measure", "metrics"]
    done = subprocess.run(
        [*command, "--results", results], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert "left out: needs PC_ERROR=/path/to/pc_error" in done.stdout
    assert results.read_text() == text

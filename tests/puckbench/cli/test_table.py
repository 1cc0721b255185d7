"""`puckbench table`: tables of a finished run for a paper."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from puckbench.cli import main

QUALITIES = [40.0, 50.0, 60.0, 70.0]


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Results of a run in which codec `b` needs half of the bits of `a`, or a little more."""
    tables = tmp_path / "results" / "tables"
    tables.mkdir(parents=True)
    rows = [
        {
            "dataset": "d",
            "cloud": f"c{cloud}",
            "codec": codec,
            "rate": f"r{number}",
            "bpp": 2.0**number * factor * (1 + cloud / 100 * (codec == "b")),
            "d1_psnr": quality,
            "d2_psnr": quality + 1,
            "points_in": 100,
            "bytes": 10,
        }
        for cloud in range(6)
        for codec, factor in (("a", 1.0), ("b", 0.5))
        for number, quality in enumerate(QUALITIES)
    ]
    pd.DataFrame(rows).to_parquet(tables / "metrics.parquet")
    looks = {"codec": ["a", "b"], "title": ["Anchor", "B & C"]}
    pd.DataFrame(looks).assign(colour="", marker="", line="").to_parquet(tables / "codecs.parquet")
    monkeypatch.chdir(tmp_path)
    options = ["--options", '{"anchor": "a"}']
    assert main(["table", "bd_rate", "results", str(tables / "bd_rate.parquet"), *options]) == 0
    return tables


def _answer(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    capsys.readouterr()
    assert main(["table", *words]) == 0
    return capsys.readouterr().out


def _refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    capsys.readouterr()
    assert main(["table", *words]) == 2
    captured = capsys.readouterr()
    assert not captured.out
    (line,) = captured.err.splitlines()
    return line.removeprefix("puckbench: ")


def test_a_finished_table_is_printed_as_latex(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    columns = ["--columns", "metric,codec,bd_rate_percent,verdict"]
    text = _answer(capsys, "bd_rate", *columns, "--tex")
    assert text == _answer(capsys, "bd_rate", "results", *columns, "--tex")
    lines = text.splitlines()
    assert lines[2] == r"Metric & Codec & BD-rate (\%) & Verdict \\"
    logs = np.log(0.5 * (1 + np.arange(6) / 100))
    low, high = 100 * np.expm1(stats.t.interval(0.95, 5, logs.mean(), stats.sem(logs)))
    cell = rf"${100 * np.expm1(logs.mean()):.2f}\ [{low:.2f}, {high:.2f}]$"  # ±1.0
    assert lines[4] == rf"D1 PSNR & B \& C & {cell} & better \\"
    assert "95 \\% interval over scenes (n = 6)." in lines[-1]


def test_without_columns_a_table_has_its_usual_ones(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    head = _answer(capsys, "bd_rate").splitlines()[0].split()
    assert head == [
        *("dataset", "metric", "codec", "anchor"),
        *("bd_rate_percent", "bd_quality_db", "verdict", "scenes"),
    ]
    answer = json.loads(_answer(capsys, "bd_rate", "--json"))
    assert (answer["table"], answer["rows"]) == ("bd_rate", 2)
    assert answer["text"].split()[0] == "dataset"


def test_files_have_the_columns_and_their_intervals(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["bd_rate", "results", "a.csv", "a.tex", "--columns", "codec,bd_rate_percent"]
    assert "a.tex" in _answer(capsys, *words)
    assert list(pd.read_csv("a.csv")) == [
        *("codec", "bd_rate_percent", "bd_rate_percent_low", "bd_rate_percent_high"),
    ]
    assert Path("a.tex").read_text().startswith(r"\begin{tabular}{lr}")


def test_options_make_the_table_again_and_missing_tables_are_made(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    columns = ["--columns", "codec,bd_rate_percent"]
    swapped = ["--options", '{"anchor": "b"}']
    text = _answer(capsys, "bd_rate", *columns, "--tex", *swapped)
    assert r"Anchor & $95" in text
    Path("results/tables/bd_rate.parquet").unlink()
    assert _answer(capsys, "bd_rate", *columns, "--tex", *swapped) == text
    assert "options: missing a required argument: 'anchor'" in _refused(capsys, "bd_rate")
    assert _answer(capsys, "rates").split()[:4] == ["dataset", "codec", "rate", "bpp"]


def test_what_cannot_be_is_refused_in_a_line(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wide = ",".join(["codec", "metric", "anchor", "verdict", "scenes", "clouds", "compared"])
    for words, fault in (
        (["bd_rate", "--columns", "codex"], "--columns: no column 'codex'; did you mean 'codec'?"),
        (
            ["bd_rate", "--tex", "--columns", f"{wide},dataset,pooled"],
            "--columns: 9 columns, but a page has space for 8",
        ),
        (["bd_rat"], "results/tables: no table 'bd_rat'; did you mean 'bd_rate'?"),
        (["bd_rate", "none"], "none: neither results of a run nor a file (.csv, .parquet, .tex)"),
        (["bd_rate", "a.csv", "--tex"], "--tex: prints the table; the suffixes of files"),
        (["clouds"], "results/tables: no table 'clouds'"),
        (
            ["bd_rate", "results", "--inputs", '{"metrics": "m.csv"}'],
            "results: not a file to write",
        ),
    ):
        assert _refused(capsys, *words).startswith(fault), words
    assert not Path("a.csv").exists()
    np.testing.assert_array_equal(sorted(p.name for p in Path().iterdir()), ["results"])

"""`puckbench compare --published`: curves of a run beside published ones, with their conditions."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from puckbench.cli import main
from tests.support.published_lookalike import published_rows, write_source
from tests.support.reference_lookalike import MINE, rows_of, write_run


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    return write_run(tmp_path / "run", rows_of("mine", MINE))


def compare(
    capsys: pytest.CaptureFixture[str], *words: str | Path, status: int = 0
) -> tuple[str, str]:
    assert main(["compare", *map(str, words)]) == status
    shown = capsys.readouterr()
    return shown.out, shown.err


def test_files_and_values_have_the_known_ratio(
    run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = write_source(tmp_path / "theirs.csv", published_rows("Net", 1.25, frames="110"))
    known = ("--published", "--as", "objects=Things 1", "--sources", source)
    found = json.loads(compare(capsys, run_folder, *known, "--json")[0])
    assert found["differences"] == {"[1]": "frames 110 (here 4)"}
    assert [(row["metric"], row["anchor"]) for row in found["deltas"]] == [
        ("d1_psnr", "Net"), ("d2_psnr", "Net"),
    ]  # fmt: skip
    for row in found["deltas"]:
        assert row["bd_rate_percent"] == pytest.approx(100 * (1 / 1.25 - 1), abs=1e-3)
        assert (row["bd_rate_status"], row["differs"]) == ("compared", "frames 110 (here 4)")
    titles = list(found["curves"])
    assert titles == [f"objects beside Things 1: {name} PSNR (dB)" for name in ("D1", "D2")]
    assert [[row[0], row[1], row[-1]] for row in found["curves"][titles[0]]] == [
        ["mine, 1", "this run", ""], ["Net, v7", "theirs", "[1]"],
    ]  # fmt: skip
    assert {Path(file).suffix for file in found["files"]} == {".png", ".pdf", ".svg", ".csv"}
    assert all(Path(file).stat().st_size for file in found["files"])
    picture = (run_folder / "comparison" / "published.svg").read_text(encoding="utf-8")
    assert "Net, theirs [1]" in picture
    table = pd.read_csv(run_folder / "comparison" / "published.csv")
    assert set(table.loc[table["origin"] == "theirs", "differs"]) == {"frames 110 (here 4)"}
    assert table.loc[table["origin"] == "this run", "differs"].isna().all()


def test_the_text_has_conditions_marks_and_the_source(
    run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The names of the published data sets are those of the run's own table, without `--as`."""
    source = write_source(tmp_path / "theirs.csv", published_rows("Net", 1.25, frames="110"))
    own = pd.DataFrame({"dataset": ["objects"], "published_as": ["Things 1"]})
    own.to_parquet(run_folder / "tables" / "published.parquet")
    out, _ = compare(capsys, run_folder, "--published", "--sources", source)
    lines = out.splitlines()
    assert lines[0] == "objects beside Things 1: D1 PSNR (dB)"
    assert lines[2].split("  ")[0] == "mine, 1"
    assert lines[3].endswith("[1]")
    assert any(line.endswith("[1]  −20.0 %") for line in lines)
    assert "[1] frames 110 (here 4)" in lines
    assert f"theirs: {source} (your own file)." in lines


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--published",), "--published needs --as DATASET=NAME"),
        (("--published", "--as", "objects"), "--as objects: not DATASET=NAME"),
        (("--published", "--as", "object=KITTI"), "no data set 'object'"),
        (("--published", "--as", "objects=KITI"), "did you mean 'KITTI'?"),
        (("--published", "--as", "objects=KITTI", "--sources", "none"), "no published source"),
        (("--published", "--as", "objects=KITTI", "--sources", "no.csv"), "no.csv: no such file"),
        (("--published", "--as", "objects=KITTI", "--codecs", "gpcc"), "no results of gpcc"),
        (("--published", "--as", "objects=KITTI", "--metrics", "bpp"), "no measure of the run"),
        (("--published", "--as", "objects=KITTI", "--common"), "--common is for --with"),
        (("--with", "default", "--as", "objects=KITTI"), "--as is for --published"),
        (("--with", "default", "--published"), "one of --with STUDY and --published is needed"),
        ((), "one of --with STUDY and --published is needed"),
    ],
)
def test_what_cannot_be_compared_is_told_in_one_line(
    words: tuple[str, ...], message: str, run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, err = compare(capsys, run_folder, *words, status=2)
    assert message in err
    assert (out, err.count("\n")) == ("", 1)
    assert not (run_folder / "comparison").exists()

"""The table that a run ends with."""

from __future__ import annotations

from pathlib import Path

from puckbench.figures.style import FigureStyle
from puckbench.planning.closing import closing_lines


def write_tables(results: Path) -> None:
    folder = results / "tables"
    folder.mkdir(parents=True)
    (folder / "summary.csv").write_text(
        "dataset,codec,rate,clouds,bpp,d1_psnr,encode_s,decode_s\n"
        "rooms_raw,draco,r1,2,0.5,40,0.1,0.02\nrooms_raw,draco,r2,2,4,60,0.2,0.05\n"
        "rooms_raw,gpcc,r1,2,1,50,0.3,0.1\n"
    )
    (folder / "bd_rate.csv").write_text(
        "dataset,metric,codec,bd_rate_percent\nrooms_raw,d2_psnr,draco,7\nrooms_raw,d1_psnr,draco,25.6\n"
    )


def test_each_codec_of_a_data_set_has_a_line(tmp_path: Path) -> None:
    write_tables(tmp_path)
    lines = list(closing_lines(tmp_path, FigureStyle(), "gpcc", since=0))
    assert lines[1].split() == [
        *("Rooms", "raw", "Draco", "2", "0.5", "to", "4", "40", "to", "60", "+26", "%", "0.25")
    ]
    assert lines[2].split()[-4:] == ["50", "to", "50", "0.4"]  # no BD-rate against itself
    assert lines[3].endswith("BD-rate in D1 against G-PCC.")
    assert lines[4] == f"tables:  {tmp_path / 'tables'}"


def test_a_run_that_made_no_table_says_nothing(tmp_path: Path) -> None:
    assert list(closing_lines(tmp_path, FigureStyle(), "gpcc", since=0)) == []
    write_tables(tmp_path)
    assert list(closing_lines(tmp_path, FigureStyle(), "gpcc", since=2e10)) == []

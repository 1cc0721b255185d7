"""The table that a run ends with."""

from __future__ import annotations

import re
from pathlib import Path

from puckbench.figures.style import FigureStyle
from puckbench.planning.run_summary import closing_lines, summary_rows

TABLES = ("summary", "bd_rate", "drives")


def write_tables(results: Path, scenes: int = 2) -> None:
    folder = results / "tables"
    folder.mkdir(parents=True)
    (folder / "summary.csv").write_text(
        "dataset,codec,rate,clouds,bpp,d1_psnr,encode_s,decode_s,lossless,peak,frame\n"
        "rooms_raw,draco,r1,2,0.5,40,0.1,0.02,0,30.0,metric\nrooms_raw,draco,r2,2,4,60,0.2,0.05,0,30.0,metric\n"
        "rooms_raw,draco,r3,2,9,,0.2,0.05,2,30.0,metric\nrooms_raw,gpcc,r1,2,1,50,0.3,0.1,0,30.0,metric\n"
    )
    (folder / "bd_rate.csv").write_text(
        "dataset,metric,codec,clouds,compared,scenes,verdict,bd_rate_percent,"
        "bd_rate_percent_least,bd_rate_percent_most\n"
        "rooms_raw,d2_psnr,draco,2,2,2,no verdict,7,7,7\n"
        f"rooms_raw,d1_psnr,draco,2,{scenes},{scenes},no verdict,25.6,-3.1,55\n"
    )


def test_each_codec_of_a_data_set_has_a_line(tmp_path: Path) -> None:
    write_tables(tmp_path)
    lines = list(closing_lines(tmp_path, FigureStyle(), "gpcc", 0, TABLES))
    assert lines[1].replace("\xa0", " ").split() == [
        *("Rooms", "raw", "Draco", "2", "0.5", "to", "9", "40", "to", "60"),
        *("+25.6", "%", "(−3.1", "%", "to", "+55.0", "%,", "2", "scenes,", "no", "verdict)"),
        "0.25",
    ]
    assert lines[2].split()[-4:] == ["50", "to", "50", "0.4"]  # no BD-rate against itself
    assert lines[3].endswith("BD-rate in D1 against G-PCC.")
    assert lines[4] == "Peak of the PSNRs: Rooms raw 30 m."
    assert lines[5] == "Lossless, so without PSNR and in no BD-rate: Rooms raw, Draco r3."
    assert lines[6] == f"tables:  {tmp_path / 'tables'}"


def test_a_bd_rate_that_no_scene_has_is_no_number(tmp_path: Path) -> None:
    write_tables(tmp_path, scenes=0)
    row = summary_rows(tmp_path, FigureStyle(), "gpcc")[0]
    assert (row["bd_rate_percent"], row["bd_rate"]) == (None, "no common range")
    assert (row["peak"], row["lossless"]) == (30, ["r3"])


def test_errors_and_times_at_each_rate_follow(tmp_path: Path) -> None:
    write_tables(tmp_path)
    (tmp_path / "tables" / "rates.csv").write_text(
        "dataset,codec,rate,clouds,bpp,d1_rms_mm,q99_mm,range_rms_mm,encode_s,decode_s\n"
        "rooms_raw,draco,r1,2,0.5,4.25,12,,1.5,0.25\nrooms_raw,draco,r2,2,4,0,0,,3,0.5\n"
    )
    lines = list(closing_lines(tmp_path, FigureStyle(), "gpcc", 0, TABLES))
    heads, first, second, remark = lines[7:11]
    names = ["bits per point", "D1, mm", "99 %, mm", "encode, s", "decode, s"]
    assert re.split("  +", heads) == ["data set", "codec and rate", *names]
    assert re.split("  +", first) == ["Rooms raw", "Draco r1", "0.5", "4.25", "12", "1.5", "0.25"]
    assert re.split("  +", second) == ["Rooms raw", "Draco r2", "4", "0", "0", "3", "0.5"]
    assert "times for a million points" in remark


def test_a_run_that_made_no_table_says_nothing(tmp_path: Path) -> None:
    assert list(closing_lines(tmp_path, FigureStyle(), "gpcc", 0, TABLES)) == []
    write_tables(tmp_path)
    assert list(closing_lines(tmp_path, FigureStyle(), "gpcc", 2e10, TABLES)) == []


def test_a_table_of_an_earlier_run_is_not_shown(tmp_path: Path) -> None:
    write_tables(tmp_path)
    assert list(closing_lines(tmp_path, FigureStyle(), "gpcc", 0, ("clouds", "left_out"))) == []


def test_drives_have_means_of_the_tasks_results(tmp_path: Path) -> None:
    folder = tmp_path / "tables"
    folder.mkdir()
    (folder / "drives.csv").write_text(
        "dataset,cloud,codec,rate,bpp,encode_s,seed,near_m,ate_m,odometry_skip,odometry,times\n"
        "push,a,undecoded,times,,,1,0.5,0.02,5,kiss,kept\n"
        "push,b,undecoded,times,,,2,0.7,0.04,5,kiss,kept\n"
        "push,a,draco,20mm,2,0.1,1,0.5,0.03,5,kiss,azimuth\n"
        "push,b,draco,20mm,4,0.2,2,,0.05,5,kiss,azimuth\n"
        "push,a,draco,20mm,2,0.1,1,0.9,0.3,5,kiss,none\n"
    )
    lines = list(closing_lines(tmp_path, FigureStyle(), "draco", 0, TABLES))
    assert lines[0].split("  ")[-1] == "near_m"
    assert [line.split() for line in lines[1:4]] == [
        ["Push", "undecoded", "times", "2", "0.03", "0.6"],
        ["Push", "Draco", "20mm,", "azimuth", "times", "2", "3", "0.04", "0.5"],
        ["Push", "Draco", "20mm,", "no", "times", "1", "2", "0.3", "0.9"],
    ]
    assert lines[4].startswith("Means over drives")


def test_bits_that_odometry_needs_are_shown(tmp_path: Path) -> None:
    folder = tmp_path / "tables"
    folder.mkdir()
    (folder / "odometry_bits.csv").write_text(
        "dataset,odometry,codec,times,unit,undecoded,margin,verdict,bits,rate,difference\n"
        "push,KISS-ICP,draco,azimuth,%,0.5,0.1,not worse,2.5,20mm,0.02\n"
        "push,GICP,puck,kept,mm,0,50,no rate suffices,,,\n"
    )
    tables = ("odometry_bits",)
    _, heads, first, second, remark, *_ = closing_lines(tmp_path, FigureStyle(), "", 0, tables)
    assert re.split("  +", heads)[-2:] == ["margin", "verdict"]
    cells = ["Push", "KISS-ICP, Draco, azimuth times", "20mm", "2.5", "0.5 %", "+0.02 %", "0.1 %"]
    assert re.split("  +", first) == [*cells, "not worse"]
    assert re.split("  +", second) == ["Push", "GICP, Puck", "0 mm", "50 mm", "no rate suffices"]
    assert remark.startswith("Lowest rate from which on coding adds less than the margin")


def test_many_results_of_drives_are_in_a_file(tmp_path: Path) -> None:
    folder = tmp_path / "tables"
    folder.mkdir()
    rows = "".join(f"push,a,draco,{number}mm,1\n" for number in range(25))
    (folder / "drives.csv").write_text(f"dataset,cloud,codec,rate,bpp\n{rows}")
    first, _ = closing_lines(tmp_path, FigureStyle(), "draco", 0, TABLES)
    assert first == f"Tasks on drives at each rate: {folder / 'drives.csv'}"


def test_the_ratio_to_the_files_is_followed_by_what_was_coded(tmp_path: Path) -> None:
    write_tables(tmp_path)
    (tmp_path / "tables" / "rates.csv").write_text(
        "dataset,codec,rate,clouds,bpp,file_ratio,coded,not_coded\n"
        'site,draco,r1,2,0.5,9,positions,"normals, colours"\n'
        'site,draco,r2,2,4,3,positions,"normals, colours"\n'
        'site,gpcc,r1,2,4,3,"positions, colours",normals\nrooms,gpcc,r1,2,4,,,\n'
    )
    lines = list(closing_lines(tmp_path, FigureStyle(), "gpcc", 0, TABLES))
    assert [line for line in lines if line.startswith("file / stream")] == [
        "file / stream, Site: streams of Draco contain positions; files also normals, colours.",
        "file / stream, Site: streams of G-PCC contain positions, colours; files also normals.",
    ]

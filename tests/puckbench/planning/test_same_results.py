"""Comparing two results folders."""

from pathlib import Path

import pandas as pd
import pytest

from pointkit.files import write_bytes, write_json
from pointkit.tables import write_table
from tests.support.same_results import after_a_kill, differences


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Two results folders of two runs, which took different times."""
    for name, seconds in (("a", 1.0), ("b", 2.0)):
        write_bytes(tmp_path / name / "coded" / "r1.bin", b"abc")
        times = dict.fromkeys(("encode_s", "decode_s_max", "encode_ms_per_turn"), seconds)
        write_json(tmp_path / name / "metrics" / "r1.json", {"bpp": 1.5, **times})
        for figure in ("fig_6_8", "encoding_time"):
            write_bytes(tmp_path / name / "figures" / f"{figure}.png", str(seconds).encode())
        table = f"rate,encode_s\nr1,{seconds}\n"
        write_bytes(tmp_path / name / "tables" / "metrics.csv", table.encode())
        write_bytes(tmp_path / name / "logs" / "r1.log", str(seconds).encode())
        of_snakemake = tmp_path / name / "trajectories" / "mine" / ".snakemake_timestamp"
        write_bytes(of_snakemake, str(seconds).encode())
    return tmp_path / "a", tmp_path / "b"


def test_times_and_logs_may_differ(folders: tuple[Path, Path]) -> None:
    assert differences(*folders) == []


def test_times_in_the_table_of_the_first_look_may_differ_and_nothing_else(
    folders: tuple[Path, Path],
) -> None:
    for folder, seconds in zip(folders, (1.0, 2.0), strict=True):
        table = pd.DataFrame({"rate": ["r1"], "bpp": [1.5], "encode_s": [seconds]})
        write_table(table, folder / "first_look" / "metrics.parquet")
    assert differences(*folders) == []
    table["bpp"] = 1.25
    write_table(table, folders[1] / "first_look" / "metrics.parquet")
    assert differences(*folders) == ["first_look/metrics.parquet: differs"]


def test_other_bytes_and_other_numbers_are_told(folders: tuple[Path, Path]) -> None:
    write_bytes(folders[0] / "coded" / "r1.bin", b"abd")
    write_bytes(folders[0] / "tables" / "metrics.csv", b"rate,encode_s\nr2,1.0\n")
    assert differences(*folders) == ["coded/r1.bin: differs", "tables/metrics.csv: differs"]


def test_files_that_only_one_has_are_told_unless_the_run_goes_on(
    folders: tuple[Path, Path],
) -> None:
    here, there = folders
    (here / "coded" / "r1.bin").unlink()
    write_bytes(here / "coded" / ".r2.tmp.bin", b"")
    assert differences(here, there) == [
        f"coded/.r2.tmp.bin: only in {here}",
        f"coded/r1.bin: only in {there}",
    ]
    assert after_a_kill(here, there) == []

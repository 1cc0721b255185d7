"""Around a run's jobs: space on the disk, and what is left out."""

import resource
import signal
from pathlib import Path

import pytest

from pointkit.errors import InputError
from puckbench.planning.running import check_room, left_out_lines, mark_planning


def test_a_folder_without_room_is_named(tmp_path: Path) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    heard = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(InputError, match="records: file too large"):
            check_room(tmp_path / "records")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, heard)


def test_looking_for_room_leaves_nothing(tmp_path: Path) -> None:
    check_room(tmp_path / "records")
    assert list((tmp_path / "records").iterdir()) == []


def test_a_place_that_cannot_be_a_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match="file/records: not a directory"):
        check_room(tmp_path / "file" / "records")


def test_a_folder_without_room_for_snakemake_s_records_is_named_with_advice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(".snakemake").write_bytes(b"")
    said = r"^\.snakemake: file exists; Snakemake writes there, .*: start it in another folder$"
    with pytest.raises(InputError, match=said):
        mark_planning()


def test_a_long_list_of_what_was_left_out_is_cut() -> None:
    rows = [{"file": f"{k}.ply", "reason": "empty"} for k in range(53)]
    *lines, last = left_out_lines(rows)
    assert lines == [f"left out: {k}.ply: empty" for k in range(50)]
    assert last == "left out: 3 more (tables/left_out.csv)"
    assert len(list(left_out_lines(rows[:50]))) == 50

"""Around a run's jobs: room is looked for, and errors are gathered from the logs."""

import os
import resource
import signal
from pathlib import Path

import pytest

from puckbench.core.errors import InputError
from puckbench.planning.running import check_room, failures, left_out_lines, now


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


def _log(path: Path, *lines: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{line}\n" for line in lines))


def test_errors_of_this_run_are_told_once_each_with_a_log(tmp_path: Path) -> None:
    begun = now()
    _log(tmp_path / "scans" / "a.log", "frame 1 of 24", "puckbench: disk full")
    _log(tmp_path / "scans" / "b.log", "puckbench: disk full")
    _log(tmp_path / "scans" / "c.log", "puckbench: no such file", "and it went on")
    _log(tmp_path / "empty.log")
    _log(tmp_path / "old.log", "puckbench: of another run")
    os.utime(tmp_path / "old.log", (begun - 1, begun - 1))
    told = list(failures(tmp_path, begun))
    assert told == [f"puckbench: disk full ({tmp_path / 'scans' / 'a.log'})"]


def test_of_many_errors_some_are_told(tmp_path: Path) -> None:
    for number in range(15):
        _log(tmp_path / f"{number:02}.log", f"puckbench: fault {number}")
    told = list(failures(tmp_path, now()))
    assert len(told) == 11
    assert told[-1] == f"puckbench: 5 more errors in {tmp_path}"


def test_a_long_list_of_what_was_left_out_is_cut() -> None:
    rows = [{"file": f"{k}.ply", "reason": "empty"} for k in range(53)]
    *lines, last = left_out_lines(rows)
    assert lines == [f"left out: {k}.ply: empty" for k in range(50)]
    assert last == "left out: 3 more (tables/left_out.csv)"
    assert len(list(left_out_lines(rows[:50]))) == 50

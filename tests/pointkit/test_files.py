import os
import platform
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from pointkit.errors import InputError
from pointkit.files import (
    open_file,
    read_bytes,
    read_json,
    remove_leftovers,
    sha256,
    write_bytes,
    write_json,
    written_whole,
)


def test_a_failed_write_leaves_the_old_file_and_no_temporary(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    write_bytes(path, b"old")
    with suppress(RuntimeError), written_whole(path) as temporary:
        temporary.write_bytes(b"half")
        raise RuntimeError
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_folders_are_made_and_the_temporary_keeps_the_suffix(tmp_path: Path) -> None:
    with written_whole(tmp_path / "deep" / "b.ply") as temporary:
        assert temporary.suffix == ".ply"
        temporary.write_text("x")
    assert (tmp_path / "deep" / "b.ply").read_text() == "x"


def test_json_is_the_same_whatever_the_order_of_the_keys(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", {"b": 1, "a": [0.1]})
    write_json(tmp_path / "b.json", {"a": [0.1], "b": 1})
    assert sha256(tmp_path / "a.json") == sha256(tmp_path / "b.json")
    assert read_json(tmp_path / "a.json") == {"a": [0.1], "b": 1}


def test_json_refuses_nan(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "a.json", {"a": float("nan")})
    assert not (tmp_path / "a.json").exists()


@pytest.mark.parametrize(("content", "fault"), [(b"{", "not valid JSON"), (None, "no such file")])
def test_unreadable_json_is_named(tmp_path: Path, content: bytes | None, fault: str) -> None:
    path = tmp_path / "c.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=rf"c\.json: {fault}"):
        read_json(path)


def test_writers_of_one_path_do_not_disturb_each_other(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    with written_whole(path) as first, written_whole(path) as second:
        assert first != second
        first.write_bytes(b"first")
        second.write_bytes(b"second")
    assert path.read_bytes() == b"first"  # whose block ended last
    assert list(tmp_path.iterdir()) == [path]


def test_an_error_of_another_file_is_not_said_to_be_of_the_one_written(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), written_whole(tmp_path / "a.bin"):
        (tmp_path / "input.bin").read_bytes()


def test_a_place_that_is_no_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match=r"file/deep/a\.bin: not a directory"):
        write_bytes(tmp_path / "file" / "deep" / "a.bin", b"x")


KILLED = """
import os, signal, sys
from pathlib import Path
from pointkit.files import written_whole

with written_whole(Path(sys.argv[1])) as temporary:
    temporary.write_bytes(b"half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_killed_writers_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    killed = tmp_path / "deep" / "scan.room.parquet"
    subprocess.run([sys.executable, "-c", KILLED, str(killed)], check=False)
    assert len(list(killed.parent.iterdir())) == 1
    host = platform.node().partition(".")[0]
    living = tmp_path / f".a.{host}-{os.getpid()}-01234567.tmp.ply"
    elsewhere, forgotten = (tmp_path / f".{k}.elsewhere-1-01234567.tmp.ply" for k in "ab")
    kept = {living, elsewhere, tmp_path / ".lock", tmp_path / "a.ply"}
    for path in (*kept, forgotten):
        path.write_bytes(b"")
    os.utime(forgotten, (0, 0))
    assert remove_leftovers(tmp_path) == 2
    assert {path for path in tmp_path.rglob("*") if path.is_file()} == kept


def test_a_device_is_not_read(tmp_path: Path) -> None:
    for read in (read_bytes, read_json, open_file):
        with pytest.raises(InputError, match=r"^/dev/zero: a device, not a file$"):
            read(Path("/dev/zero"))

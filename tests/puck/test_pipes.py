"""Recordings that come from pipes, and go to pipes."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from contextlib import closing
from io import BytesIO
from pathlib import Path

import pytest

from pointkit.errors import InputError
from puck import compress, decompress
from tests.support.spinning import pcap, rows, spin


def recorded() -> bytes:
    return pcap(rows(spin(packets=50)))


class Dripping(BytesIO):
    """A stream of which a read returns only some bytes, as a pipe's may."""

    def read(self, size: int | None = -1, /) -> bytes:
        return super().read(997 if size is None or size < 0 else min(size, 997))


def database(folder: Path) -> bytes:
    with closing(sqlite3.connect(folder / "bag.db3")) as bag, bag:
        bag.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, data BLOB)")
        bag.execute("INSERT INTO messages(data) VALUES (?)", (recorded(),))
    return (folder / "bag.db3").read_bytes()


@pytest.mark.parametrize("kind", ["capture", "database", "noise"])
def test_a_pipe_gives_the_bytes_of_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    data = {"capture": recorded(), "database": database(tmp_path), "noise": bytes(range(256)) * 99}
    monkeypatch.setattr("puck.recording._WINDOW", 20_000)
    (tmp_path / "file").write_bytes(data[kind])
    summary = compress(tmp_path / "file", tmp_path / "file.puck")
    stream, back = BytesIO(), BytesIO()
    assert compress(Dripping(data[kind]), stream) == summary
    assert stream.getvalue() == (tmp_path / "file.puck").read_bytes()
    assert decompress(Dripping(stream.getvalue()), back).as_json() == summary.as_json()
    assert back.getvalue() == data[kind]


def puck(*words: str, data: bytes) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "puck", *words]
    return subprocess.run(command, input=data, capture_output=True, check=False)


def test_the_commands_take_pipes(tmp_path: Path) -> None:
    data = recorded()
    small = puck("compress", "-", "-", "--effort", "fast", data=data)
    assert small.returncode == 0
    assert b"packets" in small.stderr
    assert puck("decompress", "-", "-", data=small.stdout).stdout == data
    named = puck("decompress", "-", str(tmp_path / "back"), data=small.stdout)
    assert b"packets" in named.stdout
    assert not named.stderr
    assert (tmp_path / "back").read_bytes() == data


@pytest.mark.parametrize("command", ["compress", "decompress"])
def test_a_pipe_that_fails_leaves_no_file(tmp_path: Path, command: str) -> None:
    cut = b""
    if command == "decompress":
        stream = BytesIO()
        compress(BytesIO(recorded()), stream)
        cut = stream.getvalue()[:-9]
    failed = puck(command, "-", str(tmp_path / "out"), data=cut)
    assert failed.returncode == 2
    assert failed.stderr.count(b"\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_full_device_is_told_in_one_line() -> None:
    with Path("/dev/full").open("wb") as full:
        command = [sys.executable, "-m", "puck", "compress", "-", "-", "--effort", "fast"]
        failed = subprocess.run(
            command, input=recorded(), stdout=full, stderr=subprocess.PIPE, check=False
        )
    assert failed.returncode == 2
    assert failed.stderr == b"puck: standard input or output: no space left on device\n"


def test_limits_hold_for_pipes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patches:
        patches.setattr("puck.recording._fits", lambda *_: True)
        stream = BytesIO()
        compress(BytesIO(bytes(60 << 20)), stream)
    assert len(stream.getvalue()) < 20_000
    with pytest.raises(InputError, match=r"\d+ bytes in \d+ bytes.*--trusted"):
        decompress(BytesIO(stream.getvalue()), tmp_path / "out")
    assert not list(tmp_path.iterdir())

"""``python -m puck``: a capture comes back, bad input is one line, and starting is light."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.spinning import pcap, rows, spin

CAPTURES = sorted((Path(__file__).parents[1] / "data" / "capture").glob("*.pcap"))
HEAVY = {"numpy", "numba", "pandas", "pyarrow", "rosbags", "pydantic"}


def puck(*words: object) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, "-m", "puck", *map(str, words)]
    return subprocess.run(program, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("capture", CAPTURES, ids=lambda path: path.stem)
def test_a_capture_comes_back(capture: Path, tmp_path: Path) -> None:
    small, back = tmp_path / "a.puck", tmp_path / "a.pcap"
    for words in (("compress", capture, small, "--effort", "fast"), ("decompress", small, back)):
        done = puck(*words)
        assert done.returncode == 0, done.stderr
        answer = dict(line.split() for line in done.stdout.splitlines())
        assert int(answer["bytes"]) == capture.stat().st_size
        assert int(answer["compressed_bytes"]) == small.stat().st_size
        assert answer["packets"] == "6"
    assert back.read_bytes() == capture.read_bytes()


def test_a_file_without_packets_is_told(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"a text\n" * 100)
    done = puck("compress", tmp_path / "a", tmp_path / "b")
    assert done.returncode == 0
    assert done.stderr.startswith(f"puck: {tmp_path / 'a'}: no data packets of a modelled sensor")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["pack"],
        ["compress", "a"],
        ["compress", "a", "b", "--effort", "best"],
        ["compress", "a", "b", "--key-every", "-1"],
        ["compress", "missing", "b"],
        ["decompress", "a", "b"],
        ["decompress", "a", "/proc/none/b"],
    ],
)
def test_bad_input_is_one_line(words: list[str], tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(pcap(rows(spin(packets=2))))
    program = [sys.executable, "-m", "puck", *words]
    done = subprocess.run(program, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("puck: ")
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"a text\n")
    with Path("/dev/full").open("w") as full:
        program = [sys.executable, "-m", "puck", "compress", tmp_path / "a", tmp_path / "b"]
        done = subprocess.run(program, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == "puck: standard output: no space left on device"


def test_starting_imports_nothing_heavy() -> None:
    program = "import sys, puck.__main__; puck.__main__.main(['compress']); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert HEAVY & set(done.stdout.split()) == set()

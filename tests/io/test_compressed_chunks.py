"""Chunks that a recording has compressed: what rosbags says of its own files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2

from puckbench.cli import main
from puckbench.io.recordings.compressed_chunks import compressed_chunks
from tests.support.bag_files import mcap_bytes, ros1_bag, ros2_bag


def bag(folder: Path, storage: str, compression: str | None) -> Path:
    if storage == "ROS1":
        ros1_bag(folder / "a.bag", compression)
        return folder / "a.bag"
    ros2_bag(folder / "bag", storage, compression)
    return next(path for path in (folder / "bag").iterdir() if path.suffix != ".yaml")


def test_bytes_of_chunks_are_those_of_the_index_of_an_mcap_file(tmp_path: Path) -> None:
    path = bag(tmp_path, "MCAP", "STORAGE")
    with Reader2(path) as reader:
        lengths = [chunk.chunk_length - 9 for chunk in reader.storage.chunks]
    assert compressed_chunks(path) == {"zstd": sum(lengths)}


@pytest.mark.parametrize("compression", ["LZ4", "BZ2"])
def test_bytes_of_chunks_are_those_of_a_ros_1_bag(tmp_path: Path, compression: str) -> None:
    path = bag(tmp_path, "ROS1", compression)
    with Reader1(path) as reader:
        sizes = [chunk.datasize for chunk in reader.chunks.values()]
    assert compressed_chunks(path) == {compression.lower(): sum(sizes)}


@pytest.mark.parametrize("storage", ["MCAP", "ROS1", "SQLITE3"])
def test_other_recordings_have_none(tmp_path: Path, storage: str) -> None:
    assert compressed_chunks(bag(tmp_path, storage, None)) == {}


def test_chunks_without_compression_are_not_counted(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(mcap_bytes())
    assert compressed_chunks(tmp_path / "a.mcap") == {}


@pytest.mark.parametrize(("storage", "compression"), [("MCAP", "STORAGE"), ("ROS1", "LZ4")])
def test_a_damaged_recording_has_at_most_its_bytes(
    tmp_path: Path, storage: str, compression: str
) -> None:
    whole = bag(tmp_path, storage, compression).read_bytes()
    random = np.random.default_rng(0)
    for _ in range(200):
        stream = bytearray(whole)
        stream[int(random.integers(len(stream)))] = int(random.integers(256))
        (tmp_path / "a").write_bytes(stream[: int(random.integers(len(stream) + 1))])
        assert sum(compressed_chunks(tmp_path / "a").values()) <= len(whole)


def test_compress_says_why_compressed_chunks_stay_as_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bag(tmp_path, "MCAP", "STORAGE")
    assert main(["compress", str(path), str(tmp_path / "a.puck"), "--json"]) == 0
    printed = capsys.readouterr()
    answer, line = json.loads(printed.out), printed.err.splitlines()[-1]
    assert answer["compressed_chunks"] == compressed_chunks(path)
    share = 100 * answer["compressed_chunks"]["zstd"] / path.stat().st_size
    assert f": {share:.0f} % of its bytes are chunks compressed by zstd" in line
    assert line.endswith("decompress the file first (mcap decompress)")

"""Bags of Ouster's driver: packets and metadata in them, for reading and for compression."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from puck import compress, decompress
from puckbench.recordings.cloud_messages import has_clouds
from puckbench.recordings.reading import read_recording, read_turns
from puckbench.scene_sets.recordings import Recordings
from tests.puckbench.recordings.test_ouster import DUAL
from tests.support.ouster import bag, images, metadata, packets

TEXT = json.dumps(metadata(DUAL))
SENT = [packet for frame in range(3) for packet in packets(DUAL, *images(DUAL), frame)]
FORMS = [
    ("ros1", "ouster_ros", b""),
    ("ros1", "ouster_ros", b"\0"),  # as older drivers
    ("sqlite3", "ouster_msgs", b""),
    ("mcap", "ouster_sensor_msgs", b""),
]


def file_of(path: Path) -> Path:
    if path.is_file():
        return path
    return next(each for each in path.iterdir() if each.suffix != ".yaml")


@pytest.mark.parametrize(("storage", "package", "extra"), FORMS)
def test_packets_and_metadata_are_read_and_compressed(
    storage: str, package: str, extra: bytes, tmp_path: Path
) -> None:
    path = bag(tmp_path / "drive.bag", SENT, TEXT, storage, package, extra)  # type: ignore[arg-type]
    assert not has_clouds(path)
    read = read_turns(path)
    assert read.whole == range(3)
    np.testing.assert_array_equal(read.returns.turns[1].ranges, images(DUAL)[0])
    table = read_recording(path)
    assert table.about["topic"] == "/ouster/lidar_packets"
    assert table["timestamp"][-1] == pytest.approx((3 * 512 - 1) * 100e-6)
    assert len(Recordings(path=str(path)).names()) == 3

    file = file_of(path)
    (tmp_path / "back").mkdir()
    summary = compress(file, tmp_path / "small.puck")
    assert (summary.packets, summary.turns, summary.metadata) == (96, 3, b"")
    decompress(tmp_path / "small.puck", tmp_path / "back" / file.name)
    assert (tmp_path / "back" / file.name).read_bytes() == file.read_bytes()
    assert len(list((tmp_path / "back").iterdir())) == 1
    path.rename(tmp_path / "elsewhere")
    again = Recordings(path=str(tmp_path / "small.puck"))
    np.testing.assert_array_equal(
        again.load("small_0002").returns.turns[0].ranges,  # type: ignore[union-attr]
        images(DUAL)[0],
    )


def test_metadata_beside_a_bag_describe_it(tmp_path: Path) -> None:
    path = bag(tmp_path / "drive.bag", SENT, None)
    with pytest.raises(InputError, match=r"no topics of metadata .* beside it \(drive.json\)$"):
        read_turns(path)
    assert has_clouds(path)
    path.with_suffix(".json").write_text(TEXT)
    assert len(read_turns(path).returns.turns) == 3
    summary = compress(path, tmp_path / "small.puck")
    assert (summary.packets, summary.metadata) == (96, TEXT.encode())


@pytest.mark.parametrize(
    ("about", "message"),
    [
        ("no JSON", "/ouster/metadata: not valid JSON"),
        ("{}", "/ouster/metadata: not the metadata of an Ouster sensor"),
        (
            json.dumps(metadata("LEGACY")),
            r"packets of 4,352 bytes, which /ouster/metadata \(OS-0-16, LEGACY, .* not describe$",
        ),
    ],
)
def test_wrong_metadata_are_one_line(about: str, message: str, tmp_path: Path) -> None:
    path = bag(tmp_path / "drive.bag", SENT, about)
    with pytest.raises(InputError, match=message):
        read_turns(path)
    assert compress(path, tmp_path / "small.puck").packets == 0 or "LEGACY" in about


def test_a_bag_without_packets_names_the_topic(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="topic /ouster/lidar_packets has no packet"):
        read_turns(bag(tmp_path / "drive.bag", [], TEXT))

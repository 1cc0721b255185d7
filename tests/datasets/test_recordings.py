"""Recordings as a data set: whole turns, by name."""

from pathlib import Path

import numpy as np
import pytest

from puckbench.core.errors import InputError
from puckbench.datasets.registry import open_scene_set
from tests.support.spinning import pcap, spin


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of some 5 and some 2 turns, and a file that is none."""
    folder = tmp_path_factory.mktemp("recordings")
    for name, packets in (("drive b", 100), ("a", 42)):
        payloads = [bytes(one) for one in spin(packets=packets, rise=160)]
        (folder / f"{name}.pcap").write_bytes(pcap(payloads))
    (folder / "notes.txt").write_text("nothing")
    return folder


def test_whole_turns_are_taken_by_file_and_number(folder: Path) -> None:
    scenes = open_scene_set("recordings", {"path": str(folder)})
    # 100 packets of 12 blocks by 1.6 degrees: from 14 degrees on, 5.3 turns.
    assert scenes.names() == ["a_0001", *(f"drive_b_000{turn}" for turn in (1, 2, 3, 4))]
    scene = scenes.load("drive_b_0002")
    assert scene.group == "drive_b"
    assert scene.returns is not None
    (turn,) = scene.returns.turns
    assert 360 / 1.6 - 13 < len(turn.azimuths) < 360 / 1.6 + 13
    assert scenes.files("drive_b_0002") == [folder / "drive b.pcap"]
    assert scene.about["first_turn"] == 2


def test_turns_are_joined_and_left_out(folder: Path) -> None:
    path = str(folder / "drive b.pcap")
    scenes = open_scene_set("recordings", {"path": path, "turns": 2})
    assert scenes.names() == ["drive_b_0001", "drive_b_0003"]
    single = open_scene_set("recordings", {"path": path, "every": 3})
    assert single.names() == ["drive_b_0001", "drive_b_0004"]
    both = scenes.load("drive_b_0003").returns
    parts = [single.load("drive_b_0004").returns]
    assert both is not None
    assert parts[0] is not None
    np.testing.assert_array_equal(both.turns[1].ranges, parts[0].turns[0].ranges)


def test_a_start_can_be_left_out(folder: Path) -> None:
    path = str(folder / "drive b.pcap")
    whole = open_scene_set("recordings", {"path": path}).names()
    later = open_scene_set("recordings", {"path": path, "start_s": 0.05}).names()
    assert 1 <= len(later) < len(whole)


def test_what_is_missing_is_told(folder: Path, tmp_path: Path) -> None:
    for path, why in (
        (tmp_path / "none", "no such file or folder"),
        (tmp_path, "no recording there"),
        (folder / "notes.txt", "notes.txt"),
    ):
        with pytest.raises(InputError, match=why):
            open_scene_set("recordings", {"path": str(path)}).names()
    short = tmp_path / "short.pcap"
    short.write_bytes(pcap([bytes(one) for one in spin(packets=4)]))
    with pytest.raises(InputError, match="no whole turn"):
        open_scene_set("recordings", {"path": str(short)}).names()
    with pytest.raises(InputError, match="no scene 'a_0009'"):
        open_scene_set("recordings", {"path": str(folder)}).load("a_0009")

"""Turns of long recordings are those of recordings that are read as a whole."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.lidar.returns import Returns
from puck import CodingOptions, compress
from puckbench.recordings import long_recordings, reading
from puckbench.scene_sets.registry import open_scene_set
from puckbench.scene_sets.selected_turns import read_selected_turns
from tests.support.ouster import capture, images, metadata, packets
from tests.support.spinning import DUAL, HDL32E, HDL64E, STRONGEST, pcap, rows, spin


def assert_same(some: Returns, whole: Returns) -> None:
    assert len(some.turns) == len(whole.turns)
    assert (some.points() == whole.points()).all()
    for turn, other in zip(some.turns, whole.turns, strict=True):
        for name in ("ranges", "azimuths", "times", "reflectivities"):
            assert np.array_equal(getattr(turn, name), getattr(other, name))


def recordings() -> dict[str, bytes]:
    packets = rows(spin(packets=120))
    swapped = [*packets[:50], packets[51], packets[50], *packets[52:]]
    return {
        "vlp16": pcap(packets),
        "hdl32e, two returns": pcap(rows(spin(HDL32E, DUAL, packets=240))),
        "hdl64e": pcap(rows(spin(HDL64E, STRONGEST, packets=240))),
        "repeated": pcap([each for packet in packets for each in (packet, packet)]),
        "out of order": pcap(swapped),
        "two sensors": pcap([*packets, *rows(spin(HDL32E, packets=90))]),
    }


IN_PARTS = ("vlp16", "hdl32e, two returns")


@pytest.mark.parametrize("suffix", [".pcap", ".puck"])
@pytest.mark.parametrize("name", recordings())
def test_turns_are_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, suffix: str
) -> None:
    path = tmp_path / f"a{suffix}"
    (tmp_path / "a.pcap").write_bytes(recordings()[name])
    compress(tmp_path / "a.pcap", tmp_path / "a.puck", CodingOptions(effort="fast", key_every=2))

    def read(turns: tuple[int, int] | None) -> Returns | str:
        try:
            return read_selected_turns(path, turns)[0]
        except InputError as error:
            return str(error)

    selections = (None, (0, 0), (2, 4), (4, 4), (3, 99))
    expected = [read(turns) for turns in selections]
    monkeypatch.setattr(long_recordings, "_LONG_BYTES", 0)
    for turns, whole in zip(selections, expected, strict=True):
        some = read(turns)
        if isinstance(some, str) or isinstance(whole, str):
            assert some == whole
        else:
            assert_same(some, whole)
    if name in IN_PARTS:
        monkeypatch.setattr(reading, "read_packets", None)
        read_selected_turns(path, (2, 4))


@pytest.mark.parametrize("suffix", [".pcap", ".puck"])
def test_turns_of_an_ouster_are_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    profile = "RNG19_RFL8_SIG16_NIR16"
    (tmp_path / "a.json").write_text(json.dumps(metadata(profile)))
    sent = [packets(profile, *images(profile, frame), frame=frame) for frame in range(3)]
    (tmp_path / "a.pcap").write_bytes(capture([each for turn in sent for each in turn]))
    compress(tmp_path / "a.pcap", tmp_path / "a.puck", CodingOptions(effort="fast"))
    path = tmp_path / f"a{suffix}"
    expected = [read_selected_turns(path, turns)[0] for turns in (None, (1, 1))]
    monkeypatch.setattr(long_recordings, "_LONG_BYTES", 0)
    monkeypatch.setattr(reading, "read_packets", None)
    assert_same(read_selected_turns(path, None)[0], expected[0])
    assert_same(read_selected_turns(path, (1, 1))[0], expected[1])


def test_scenes_of_a_long_recording_are_read_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.pcap").write_bytes(recordings()["vlp16"])

    def scenes() -> dict[str, Any]:
        loader = open_scene_set("recordings", {"path": str(tmp_path / "a.pcap"), "turns": 2})
        return {name: loader.load(name).returns for name in loader.names()}

    expected = scenes()
    monkeypatch.setattr(long_recordings, "_LONG_BYTES", 0)
    monkeypatch.setattr(reading, "read_packets", None)
    some = scenes()
    assert list(some) == list(expected)
    for name, returns in some.items():
        assert_same(returns, expected[name])

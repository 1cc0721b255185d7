"""Turns of long recordings are those of recordings that are read as a whole."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.lidar.returns import Returns
from pointkit.lidar.sensors import load_sensor
from puck import CodingOptions, compress
from puck.packet_kinds import VELODYNE
from puck.recordings.packets import PACKET
from puck.turn_packets import TurnIndex
from puckbench.recordings import long_recordings, reading
from puckbench.scene_sets.registry import open_scene_set
from puckbench.scene_sets.selected_turns import read_selected_turns
from tests.puckbench.recordings.test_unit_calibration import status
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
@pytest.mark.parametrize("pause", [0, 3])
def test_turns_know_when_they_began(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, pause: int
) -> None:
    """The hour of the sensor's clock begins anew, and other datagrams come first."""
    packets = rows(spin(packets=120))
    (tmp_path / "a.pcap").write_bytes(pcap([b"other" * 20] * pause + packets))
    compress(tmp_path / "a.pcap", tmp_path / "a.puck", CodingOptions(effort="fast", key_every=2))
    options = {"path": str(tmp_path / f"a{suffix}")}

    def times() -> list[float | None]:
        loader = open_scene_set("recordings", options)
        return [loader.load(name).time_s for name in loader.names()]

    expected = times()
    monkeypatch.setattr(long_recordings, "_LONG_BYTES", 0)
    monkeypatch.setattr(reading, "read_packets", None)
    assert times() == pytest.approx(expected, abs=1e-6)


def test_hours_of_the_sensors_clock_are_counted() -> None:
    """Turn 72,000 of a sensor at 10 Hz begins two hours after the first."""
    packets = spin(packets=75)

    class Index(TurnIndex):
        count = 80_000

        def start(self) -> bytes:
            return pcap(rows(packets))

        def packets(self, first: int, end: int) -> list[np.ndarray]:
            return [packets]

    clock = packets.copy().view(PACKET)
    first_us = clock["time_us"][0, 0].astype(np.int64)
    since_us = 7_200_000_000 + np.rint(np.arange(75) * 1e5 / 75).astype(np.int64)
    clock["time_us"][:, 0] = (first_us + since_us) % 3_600_000_000
    index = Index(Path("a.pcap"), next(VELODYNE.split_turns(packets))[0], b"")
    began = long_recordings._begun_s(index, 72_000, clock.view(np.uint8))
    assert began == pytest.approx(1.6e9 + 7200, abs=1e-3)


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


def test_an_hdl64e_is_calibrated_by_its_first_packets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packets = spin(HDL64E, STRONGEST, packets=4400)
    packets[:, -2:] = status(load_sensor("hdl64e_s3"), len(packets), first=0)
    (tmp_path / "a.pcap").write_bytes(pcap(rows(packets)))
    expected = [read_selected_turns(tmp_path / "a.pcap", turns)[0] for turns in (None, (90, 91))]
    monkeypatch.setattr(long_recordings, "_LONG_BYTES", 0)
    monkeypatch.setattr(reading, "read_packets", None)
    for turns, whole in zip((None, (90, 91)), expected, strict=True):
        some, _ = read_selected_turns(tmp_path / "a.pcap", turns)
        assert some.beams == whole.beams
        assert_same(some, whole)


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

"""Captures of sensors with different formats of packets, and metadata that do not fit."""

from __future__ import annotations

import json
import lzma
from pathlib import Path

import numpy as np
import pytest

from puck import compress, decode_turns, decompress
from puck.recording import RecordingSummary
from puck.recordings.ouster import OusterSensor, sensor_of
from puck.recordings.packet_turns import split_turns, turn_of
from tests.puck.test_ouster import sent
from tests.support.capture_bytes import ethernet, ipv4, pcap, udp
from tests.support.ouster import metadata
from tests.support.spinning import HDL32E, VLP16, rows, spin

LEGACY, FINE, COARSE = "LEGACY", "RNG19_RFL8_SIG16_NIR16", "RNG15_RFL8_NIR8"


def ouster(profile: str, lasers: int = 16) -> OusterSensor:
    return sensor_of(json.dumps(metadata(profile, lasers)).encode(), profile)


def framed(payloads: list[bytes], host: int, port: int = 7502) -> list[bytes]:
    return [ethernet(ipv4(udp(payload, port, port), f"10.0.0.{host}")) for payload in payloads]


def mixed(*streams: list[bytes]) -> bytes:
    """A capture in which the frames of each stream are spread evenly."""
    places = [np.linspace(0, 1, len(stream)) + 1e-6 * k for k, stream in enumerate(streams)]
    order = np.argsort(np.concatenate(places), kind="stable")
    frames = [frame for stream in streams for frame in stream]
    return pcap(*(frames[k] for k in order), step_us=500)


def there_and_back(
    folder: Path, data: bytes, files: dict[str, object] | None = None
) -> RecordingSummary:
    for path in folder.glob("*.json"):
        path.unlink()
    for name, content in (files or {}).items():
        text = content if isinstance(content, str) else json.dumps(content)
        (folder / f"{name}.json").write_text(text)
    (folder / "drive.pcap").write_bytes(data)
    account = compress(folder / "drive.pcap", folder / "drive.puck")
    decompress(folder / "drive.puck", folder / "back")
    assert (folder / "back").read_bytes() == data
    return account


def xz(data: bytes) -> int:
    return len(lzma.compress(data, preset=9 | lzma.PRESET_EXTREME))


def test_velodynes_of_two_products(tmp_path: Path) -> None:
    streams = [
        framed(rows(spin(product, packets=100, seed=product)), product, 2368 + product)
        for product in (VLP16, HDL32E)
    ]
    alone = [there_and_back(tmp_path, mixed(stream)).compressed for stream in streams]
    account = there_and_back(tmp_path, mixed(*streams))
    assert account.packets == 200
    assert account.compressed < 1.02 * sum(alone)


def test_a_velodyne_and_an_ouster(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    files: dict[str, object] = {"drive": metadata(COARSE)}
    velodyne = spin(packets=100)
    streams = [framed(sent(ouster(COARSE)), 1), framed(rows(velodyne), 2, 2368)]
    alone = [there_and_back(tmp_path, mixed(stream), files) for stream in streams]
    account = there_and_back(tmp_path, mixed(*streams), files)
    assert account.packets == sum(each.packets for each in alone) == 164
    assert account.turns == sum(each.turns for each in alone)
    assert account.compressed < 1.02 * sum(each.compressed for each in alone)
    turns = decode_turns((tmp_path / "drive.puck").read_bytes())
    expected = [turn_of(*part).ranges for part in split_turns(velodyne)]
    found = [turn.ranges for turn in turns if turn.ranges.dtype == expected[0].dtype]
    assert all(any(np.array_equal(each, other) for other in found) for each in expected)
    assert not caplog.messages


def test_two_profiles_of_ousters(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The metadata of the second are told to be left out."""
    files: dict[str, object] = {"drive_0": metadata(LEGACY), "drive_1": metadata(FINE)}
    streams = [framed(sent(ouster(LEGACY)), 1), framed(sent(ouster(FINE), seed=1), 2, 7503)]
    alone = [
        there_and_back(tmp_path, mixed(stream), {"drive": content}).compressed
        for stream, content in zip(streams, files.values(), strict=True)
    ]
    assert not caplog.messages
    account = there_and_back(tmp_path, mixed(*streams), files)
    assert account.packets == 128
    assert account.metadata == (tmp_path / "drive_0.json").read_bytes()
    assert account.compressed < 1.02 * sum(alone)
    (line,) = caplog.messages
    assert line.endswith("drive_1.json is not stored with the packets that it describes: keep it")
    (tmp_path / "drive_1.json").unlink()
    one = compress(tmp_path / "drive.pcap", tmp_path / "drive.puck")
    assert one.packets == 64
    assert account.compressed < one.compressed < xz((tmp_path / "drive.pcap").read_bytes())


def test_packets_without_metadata_cost_no_more_than_xz(tmp_path: Path) -> None:
    """Most bytes are of the sensor that is not known."""
    streams = [framed(sent(ouster(FINE, 32)), 1), framed(rows(spin(packets=20)), 2, 2368)]
    data = mixed(*streams)
    account = there_and_back(tmp_path, data)
    assert account.packets in (0, 20)
    assert account.compressed <= xz(data)


def test_formats_change_from_part_to_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("puck.recording._WINDOW", 60_000)
    streams = [framed(sent(ouster(COARSE)), 1), framed(rows(spin(packets=100)), 2, 2368)]
    files: dict[str, object] = {"drive": metadata(COARSE)}
    data = pcap(*streams[1][:50], *streams[0][:30], *streams[1][50:], *streams[0][30:])
    assert there_and_back(tmp_path, data, files).packets == 164
    assert there_and_back(tmp_path, mixed(*streams), files).packets == 164
    monkeypatch.setattr("puck.sensors._MOST_SENSORS", 1)  # no number is left for the Ouster
    assert there_and_back(tmp_path, mixed(*streams), files).packets == 100


@pytest.mark.parametrize(
    ("content", "packets", "told"),
    [
        (
            {**metadata(COARSE), "sensor_info": {"prod_line": "OS-0-16", "prod_sn": "7"}},
            64,
            "drive.pcap: packets of the sensor 992137000142, and drive.json is of 7: it is not "
            "stored with them",
        ),
        (
            metadata(COARSE, lasers=32),
            0,
            "drive.pcap: has no packets that drive.json (OS-0-16, RNG15_RFL8_NIR8, packets of "
            "2,304 bytes) describes: compressed without it",
        ),
        ('{"beam_intrinsics": {', 0, "drive.json: not valid JSON ("),
        ("{}", 0, "drive.json: not the metadata of an Ouster sensor: compressed without it"),
    ],
)
def test_metadata_that_do_not_fit_are_told_and_left_out(
    content: object, packets: int, told: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    data = mixed(framed(sent(ouster(COARSE)), 1))
    account = there_and_back(tmp_path, data, {"drive": content})
    assert (account.packets, account.metadata) == (packets, b"")
    (line,) = caplog.messages
    assert line.startswith(f"{tmp_path}/{told}")
    assert not (tmp_path / "back.json").exists()


def test_other_files_beside_a_capture_of_a_velodyne_are_not_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    data = mixed(framed(rows(spin(packets=40)), 1, 2368))
    for content in ("{}", metadata(COARSE)):
        assert there_and_back(tmp_path, data, {"drive": content}).packets == 40
    assert not caplog.messages

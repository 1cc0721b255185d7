"""Packets out of order, lost or of clocks and encoders that leap: sorted, or told in one line."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.lidar.return_table import ReturnTable
from puck.recordings.ouster import packet_type
from puck.recordings.packet_turns import decode_packets
from puck.recordings.packets import PACKET, PacketLog
from puckbench.recordings.reading import read_recording, read_turns
from puckbench.recordings.writing import pcap_bytes
from tests.support.capture_lookalike import box_capture
from tests.support.ouster import capture, images, metadata, packets

LOG = box_capture(160)
"""Two turns and a part of a third, over the full hour."""
HALF, HOUR_US = len(LOG) // 2, 3_600_000_000
COARSE = "RNG15_RFL8_NIR8"


def written(path: Path, log: PacketLog) -> Path:
    path.write_bytes(pcap_bytes(log))
    return path


def taken(rows: Any) -> PacketLog:
    """The packets `rows` of the recording, each received when it comes."""
    count = len(LOG.payloads[rows])
    return PacketLog(LOG.payloads[rows], LOG.received[0] + 1327e-6 * np.arange(count), {})


def changed(change: Callable[[NDArray[Any]], None]) -> PacketLog:
    """The recording with its packets' fields changed."""
    table = LOG.payloads.copy().view(PACKET)[:, 0]
    change(table)
    return replace(LOG, payloads=table.view(np.uint8).reshape(len(LOG), -1))


def same(table: ReturnTable, other: ReturnTable) -> bool:
    return all(np.array_equal(table[name], other[name]) for name in table.columns)


def lines(path: Path, caplog: pytest.LogCaptureFixture) -> list[str]:
    assert all(line.startswith(f"{path}: ") for line in caplog.messages)
    return [line.removeprefix(f"{path}: ") for line in caplog.messages]


def swapped() -> NDArray[np.intp]:
    """Every seventh pair is swapped."""
    rows = np.arange(len(LOG))
    first = np.arange(0, len(LOG) - 1, 7)
    rows[first], rows[first + 1] = first + 1, first
    return rows


def late(places: int) -> NDArray[np.intp]:
    return np.insert(np.delete(np.arange(len(LOG)), 30), 30 + places, 30)


@pytest.mark.parametrize(
    ("rows", "count"),
    [(swapped(), 23), (late(1), 1), (late(40), 1), (np.r_[0:80, 90:85:-1, 80:86, 91:160], 5)],
    ids=["pairs", "one", "far", "reversed"],
)
def test_packets_out_of_order_are_sorted_and_told(
    rows: NDArray[np.intp], count: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = written(tmp_path / "a.pcap", taken(rows))
    table = read_recording(path)
    assert same(table, decode_packets(LOG.payloads))
    assert table.about["late_packets"] == count
    are_late = f"{count} packets are" if count > 1 else "1 packet is"
    assert lines(path, caplog) == [f"sorted by the sensor's clock, as {are_late} late"]
    returns, whole, *_ = read_turns(path)
    assert len(returns.turns) == 4
    assert whole == range(1, 3)


def test_a_recording_in_order_is_read_without_a_word(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Its clock passes the full hour."""
    table = read_recording(written(tmp_path / "a.pcap", LOG))
    assert same(table, decode_packets(LOG.payloads))
    assert not caplog.messages


def test_repeated_packets_are_left_out_wherever_they_come(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = written(tmp_path / "a.pcap", taken(np.r_[0:20, 3:20, 20:160, 7]))
    assert same(read_recording(path), decode_packets(LOG.payloads))
    assert lines(path, caplog) == ["left out packets that repeat one before, byte by byte (18)"]


@pytest.mark.parametrize(
    ("lost", "place"),
    [
        ([40], "at packet 40"),
        ([40, 41, 42], "at packet 40"),
        ([5, 50, 51, 120], "at 3 of 156 packets, first packet 5"),
    ],
)
def test_lost_packets_are_counted(
    lost: Sequence[int], place: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rows = np.delete(np.arange(len(LOG)), lost)
    path = written(tmp_path / "a.pcap", taken(rows))
    table, whole = read_recording(path), decode_packets(LOG.payloads)
    kept = ~np.isin(np.repeat(np.arange(160), 24 * 15), lost)
    assert np.allclose(table["timestamp"], whole["timestamp"][kept], atol=1e-9)
    assert np.array_equal(table["turn"], whole["turn"][kept])
    assert lines(path, caplog) == [f"about {len(lost)} packets are lost ({place})"]


def test_a_pause_of_the_recorder_is_lost_packets_and_no_leap(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def later(table: NDArray[Any]) -> None:
        table["time_us"][HALF:] += 1327 * 2000

    log = changed(later)
    received = LOG.received + 1327e-6 * 2000 * (np.arange(len(LOG)) >= HALF)
    path = written(tmp_path / "a.pcap", replace(log, received=received))
    read_recording(path)
    assert lines(path, caplog) == ["about 2,000 packets are lost (at packet 80)"]


@pytest.mark.parametrize("leap_s", [100.0, 0.6, -0.6, -3.0, -100.0])
def test_a_leap_of_the_clock_is_told_and_left_out(
    leap_s: float, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """As when a GPS is found; packets before and after are not mixed."""

    def leaping(table: NDArray[Any]) -> None:
        after = table["time_us"][HALF:].astype(np.int64) + round(leap_s * 1e6)
        table["time_us"][HALF:] = after % HOUR_US

    path = written(tmp_path / "a.pcap", changed(leaping))
    table, whole = read_recording(path), decode_packets(LOG.payloads)
    assert np.array_equal(table["azimuth"], whole["azimuth"])
    assert np.abs(table["timestamp"] - whole["timestamp"]).max() < 2e-6
    step = f"{leap_s + 1.327e-3:.4f}"[:5]
    (line,) = lines(path, caplog)
    assert line.startswith(f"the sensor's clock leaps (at packet 80: {step}")


def test_a_clock_that_stands_still_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def still(table: NDArray[Any]) -> None:
        table["time_us"] = 7

    path = written(tmp_path / "a.pcap", changed(still))
    assert len(read_recording(path)) == len(decode_packets(LOG.payloads))
    assert lines(path, caplog) == ["the sensor's clock stands still: points have no times"]


def test_a_leap_of_the_azimuth_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    def leaping(table: NDArray[Any]) -> None:
        azimuths = table["blocks"]["azimuth"]
        azimuths[HALF:] = (azimuths[HALF:] + 4500) % 36000

    path = written(tmp_path / "a.pcap", changed(leaping))
    read_recording(path)
    (line,) = lines(path, caplog)
    assert line == "the azimuth rises unevenly, not at 10 Hz (at packet 80: 49.78 degrees)"


def test_another_rate_of_rotation_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    def faster(table: NDArray[Any]) -> None:
        blocks = np.arange(12 * (len(LOG) - 100)).reshape(-1, 12)
        table["blocks"]["azimuth"][100:] = (79.6 * blocks).astype(np.int64) % 36000

    path = written(tmp_path / "a.pcap", changed(faster))
    read_recording(path)
    (line,) = lines(path, caplog)
    assert line.startswith(
        "the azimuth rises unevenly, not at 10 Hz (at 60 of 160 packets, first packet 100: "
    )


@pytest.mark.parametrize("rate", [0, -1])
def test_a_sensor_that_stands_or_turns_the_other_way(
    rate: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def turned(table: NDArray[Any]) -> None:
        blocks = np.arange(12 * len(LOG)).reshape(-1, 12)
        table["blocks"]["azimuth"] = (rate * 40 * blocks) % 36000

    path = written(tmp_path / "a.pcap", changed(turned))
    if rate:
        fault = "a.pcap: the azimuths of its packets fall, where those of a Velodyne rise"
        with pytest.raises(InputError, match=fault):
            read_recording(path)
        return
    read_recording(path)
    fault = "the sensor does not turn: the azimuths of its packets do not rise"
    assert lines(path, caplog) == [fault]


def test_two_sensors_in_one_stream_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Their clocks agree, as GPS sets them; or they do not."""

    def other(shift_us: int) -> PacketLog:
        table = LOG.payloads.copy().view(PACKET)[:, 0]
        azimuths = table["blocks"]["azimuth"]
        table["blocks"]["azimuth"] = (azimuths + 12_000) % 36000
        table["time_us"] = (table["time_us"].astype(np.int64) + shift_us) % HOUR_US
        both = np.stack([LOG.payloads, table.view(np.uint8).reshape(len(LOG), -1)], axis=1)
        received = np.stack([LOG.received, LOG.received + 1e-4], axis=1).ravel()
        return PacketLog(both.reshape(-1, 1206), received, {})

    for shift_us, fault in (
        (600, "the azimuth rises unevenly"),
        (5_000_000, "the sensor's clock leaps"),
    ):
        caplog.clear()
        path = written(tmp_path / "a.pcap", other(shift_us))
        read_recording(path)
        assert any(line.startswith(fault) for line in lines(path, caplog))


def test_packets_received_before_the_first_are_read(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The recorder's clock is set back, or the first two packets are swapped."""
    set_back = LOG.received - 3600 * (np.arange(160) > 20)
    line = "times of reception go back (at packet 21)"
    for received, told in ((LOG.received[swapped()], []), (set_back, [line])):
        path = written(tmp_path / "a.pcap", replace(LOG, received=received))
        assert same(read_recording(path), decode_packets(LOG.payloads))
        assert lines(path, caplog) == told
        assert len(read_turns(path).returns.turns) == 4


def ouster(path: Path, sent: Sequence[bytes]) -> Path:
    path.with_suffix(".json").write_text(json.dumps(metadata(COARSE)))
    path.write_bytes(capture(sent))
    return path


@pytest.fixture(scope="module")
def sent() -> list[bytes]:
    """Five turns of an Ouster, of 32 packets each."""
    turns = [packets(COARSE, *images(COARSE, seed=frame), frame) for frame in range(5)]
    return [packet for turn in turns for packet in turn]


def test_an_ousters_recording_in_order_is_read_without_a_word(
    sent: list[bytes], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert read_turns(ouster(tmp_path / "whole.pcap", sent)).whole == range(5)
    assert read_turns(ouster(tmp_path / "cut.pcap", sent[9:-3])).whole == range(1, 4)
    assert not caplog.messages


def test_packets_of_an_ouster_out_of_order_are_sorted_and_told(
    sent: list[bytes], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    whole = read_recording(ouster(tmp_path / "whole.pcap", sent))
    rows = np.arange(len(sent))
    rows[:-1:7], rows[1::7] = rows[1::7].copy(), rows[:-1:7].copy()
    path = ouster(tmp_path / "swapped.pcap", [sent[row] for row in rows])
    assert same(read_recording(path), whole)
    assert lines(path, caplog) == ["sorted by the sensor's clock, as 23 packets are late"]


@pytest.mark.parametrize(
    ("kept", "told"),
    [
        (np.r_[0:40, 42:160], "32 columns are lost within 5 turns"),
        (np.r_[0:64, 96:160], "512 columns are lost within 5 turns"),
        (np.r_[0:3, 4:157, 159], "48 columns are lost within 5 turns"),
        (np.r_[0:7, 9:32], "32 columns are lost within 1 turn"),
    ],
    ids=["inside", "a turn", "first and last", "of one turn"],
)
def test_lost_columns_of_an_ouster_are_counted(
    kept: Any, told: str, sent: list[bytes], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = ouster(tmp_path / "lost.pcap", [sent[row] for row in kept])
    recorded = read_turns(path)
    assert lines(path, caplog) == [told]
    assert recorded.whole == range(len(recorded.returns.turns))


def test_packets_of_an_ouster_that_come_again_are_told(
    sent: list[bytes], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = ouster(tmp_path / "repeated.pcap", sent[:40] + sent[38:])
    read_turns(path)
    assert lines(path, caplog) == [
        "sorted by the sensor's clock, as 1 packet is late",
        "left out 32 columns that repeat one before",
    ]


@pytest.mark.parametrize("leap_s", [-4, 100, 1_700_000_000])
def test_a_leap_of_an_ousters_clock_is_told_and_left_out(
    leap_s: int, sent: list[bytes], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """As when PTP sets it to the time since 1970."""
    whole = read_recording(ouster(tmp_path / "whole.pcap", sent))
    leapt = [*sent[:50], *(set_later(packet, leap_s) for packet in sent[50:])]
    path = ouster(tmp_path / "leap.pcap", leapt)
    table = read_recording(path)
    assert np.diff(table["timestamp"]).min() >= 0
    assert np.abs(table["timestamp"] - whole["timestamp"]).max() < 1e-4
    (line,) = lines(path, caplog)
    assert line.startswith(f"the sensor's clock leaps (at packet 50: {leap_s + 1.6e-3:.6g} s)")


def test_an_ouster_that_starts_anew_goes_on(
    sent: list[bytes], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Its counter of revolutions and its clock begin again."""
    late = [packets(COARSE, *images(COARSE, seed=9), 40), packets(COARSE, *images(COARSE), 41)]
    path = ouster(tmp_path / "anew.pcap", [*late[0], *late[1], *sent])
    returns, whole, *_ = read_turns(path)
    assert whole == range(7)
    np.testing.assert_array_equal(returns.turns[0].ranges, images(COARSE, seed=9)[0])
    np.testing.assert_array_equal(returns.turns[6].ranges, images(COARSE, seed=4)[0])
    (line,) = lines(path, caplog)
    assert line.startswith("the sensor's clock leaps (at packet 64: -2.1")


def set_later(packet: bytes, later_s: int) -> bytes:
    """A packet whose columns are some seconds later."""
    table = np.frombuffer(packet, packet_type(COARSE, 16)).copy()
    table["columns"]["time"] += np.int64(later_s * 10**9).astype(np.uint64)
    return table.tobytes()

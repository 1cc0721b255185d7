"""Clocks that leap by less than 0.5 s: told apart from packets that are late or lost."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from puck.recordings.ouster import packet_type
from puck.recordings.packet_turns import decode_packets
from puck.recordings.packets import PACKET, PacketLog
from puckbench.recordings.reading import read_recording, read_turns
from puckbench.recordings.writing import pcap_bytes
from tests.support.capture_lookalike import box_capture
from tests.support.ouster import capture, images, metadata, packets

LOG = box_capture(320)
"""Four turns at 10 Hz, over the full hour."""
WHOLE = decode_packets(LOG.payloads)
USUAL_S, HOUR_US = 1.327e-3, 3_600_000_000
COARSE = "RNG15_RFL8_NIR8"


def leaping(leap_s: float, first: int = 160) -> PacketLog:
    """The recording with a clock that leaps before packet `first`."""
    table = LOG.payloads.copy().view(PACKET)[:, 0]
    after = table["time_us"][first:].astype(np.int64) + round(leap_s * 1e6)
    table["time_us"][first:] = after % HOUR_US
    return replace(LOG, payloads=table.view(np.uint8).reshape(len(LOG), -1))


def written(path: Path, log: PacketLog, rows: NDArray[np.intp] | None = None) -> Path:
    """A capture of the log's packets `rows`, each received when one was before."""
    if rows is not None:
        received = LOG.received[: len(rows)]
        log = replace(log, payloads=log.payloads[rows], received=received)
    path.write_bytes(pcap_bytes(log))
    return path


def lines(path: Path, caplog: pytest.LogCaptureFixture) -> list[str]:
    return [line.removeprefix(f"{path}: ") for line in caplog.messages]


def swapped() -> NDArray[np.intp]:
    """Every seventh pair is swapped."""
    rows = np.arange(len(LOG))
    rows[:-1:7], rows[1::7] = rows[1::7].copy(), rows[:-1:7].copy()
    return rows


@pytest.mark.parametrize(
    "leap_s",
    [-0.49, -0.4, -0.37, -0.3, -0.1, -0.05, -0.004, -0.002, 0.002, 0.05, 0.1, 0.25, 0.3, 0.4],
)
def test_a_small_leap_is_told_and_left_out(
    leap_s: float, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Of these, 0.1, 0.3 and 0.4 s are whole turns."""
    path = written(tmp_path / "a.pcap", leaping(leap_s))
    table = read_recording(path)
    assert np.array_equal(table["azimuth"], WHOLE["azimuth"])
    assert np.abs(table["timestamp"] - WHOLE["timestamp"]).max() < 3e-6
    (line,) = lines(path, caplog)
    told = "the sensor's clock leaps (at packet 160: "
    assert line.startswith(told)
    step_s = float(line.removeprefix(told).split()[0])
    assert step_s == pytest.approx(leap_s + USUAL_S, abs=2e-6)
    assert line.endswith(" s); times go on without the leap")


@pytest.mark.parametrize("leap_s", [-0.4, -0.3, -0.25, -0.03])
@pytest.mark.parametrize("first", [155, 161, 162, 163])
def test_late_packets_are_sorted_before_and_after_a_leap(
    leap_s: float, first: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Packets 161 and 162 are swapped, so that the clock may leap between them."""
    path = written(tmp_path / "a.pcap", leaping(leap_s, first), swapped())
    table = read_recording(path)
    assert np.array_equal(table["azimuth"], WHOLE["azimuth"])
    assert np.abs(table["timestamp"] - WHOLE["timestamp"]).max() < 3e-6
    late, leap = lines(path, caplog)
    assert late == "sorted by the sensor's clock, as 46 packets are late"
    assert leap.startswith(f"the sensor's clock leaps (at packet {first}: ")


def test_clocks_that_leap_there_and_back(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    table = leaping(-0.3, 100).payloads.view(PACKET)[:, 0].copy()
    table["time_us"][200:] = LOG.payloads.view(PACKET)["time_us"][200:, 0]
    log = replace(LOG, payloads=table.view(np.uint8).reshape(len(LOG), -1))
    path = written(tmp_path / "a.pcap", log)
    assert np.abs(read_recording(path)["timestamp"] - WHOLE["timestamp"]).max() < 3e-6
    (line,) = lines(path, caplog)
    assert line.startswith("the sensor's clock leaps (at 2 of 320 packets, first packet 100: -0.29")


def test_packets_that_are_late_by_a_turn_are_sorted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The angle alone does not tell this from a leap."""
    for places in (74, 75, 76, 150, 151):
        caplog.clear()
        rows = np.insert(np.delete(np.arange(len(LOG)), 30), 30 + places, 30)
        path = written(tmp_path / "a.pcap", LOG, rows)
        assert np.array_equal(read_recording(path)["timestamp"], WHOLE["timestamp"])
        assert lines(path, caplog) == ["sorted by the sensor's clock, as 1 packet is late"]


@pytest.mark.parametrize("lost", [1, 40, 75, 76, 151])
def test_lost_packets_are_no_leap(
    lost: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Losses of whole turns are told from leaps by the times of reception."""
    rows = np.r_[0:100, 100 + lost : len(LOG)]
    path = tmp_path / "a.pcap"
    path.write_bytes(
        pcap_bytes(replace(LOG, payloads=LOG.payloads[rows], received=LOG.received[rows]))
    )
    read_recording(path)
    assert lines(path, caplog) == [f"about {lost} packets are lost (at packet 100)"]


@pytest.fixture(scope="module")
def sent() -> list[bytes]:
    """Eight turns of an Ouster, of 32 packets each, at 20 Hz."""
    turns = [packets(COARSE, *images(COARSE, seed=frame), frame) for frame in range(8)]
    return [packet for turn in turns for packet in turn]


def ouster(path: Path, payloads: list[bytes]) -> Path:
    path.with_suffix(".json").write_text(json.dumps(metadata(COARSE)))
    path.write_bytes(capture(payloads))
    return path


@pytest.mark.parametrize("leap_ms", [-400, -300, -51.2, -20, -3, 3, 51.2, 300])
@pytest.mark.parametrize("column", [0, 5])
def test_a_small_leap_of_an_ousters_clock_is_told_and_left_out(
    leap_ms: float, column: int, sent: list[bytes], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The clock leaps in packet 100, before the column; a turn takes 51.2 ms."""
    whole = read_recording(ouster(tmp_path / "whole.pcap", sent))
    table = np.frombuffer(b"".join(sent), packet_type(COARSE, 16)).copy()
    times = table["columns"]["time"].reshape(-1).astype(np.int64)
    times[1600 + column :] += round(leap_ms * 1e6)
    table["columns"]["time"] = times.astype(np.uint64).reshape(-1, 16)
    path = ouster(tmp_path / "leap.pcap", [packet.tobytes() for packet in table])
    returns = read_recording(path)
    assert np.array_equal(returns["azimuth"], whole["azimuth"])
    assert np.diff(returns["timestamp"]).min() >= 0
    assert np.abs(returns["timestamp"] - whole["timestamp"]).max() < 3e-6
    (line,) = lines(path, caplog)
    step_s = (leap_ms + 1.6) * 1e-3
    assert line.startswith(
        f"the sensor's clock leaps (at packet {100 + (column > 0)}: {step_s:.6g} s)"
    )
    assert read_turns(path).whole == range(8)


def test_swapped_packets_of_an_ouster_are_sorted_at_a_leap(
    sent: list[bytes], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    whole = read_recording(ouster(tmp_path / "whole.pcap", sent))
    table = np.frombuffer(b"".join(sent), packet_type(COARSE, 16)).copy()
    table["columns"]["time"][100:] -= np.uint64(200_000_000)
    rows = np.arange(len(sent))
    rows[:-1:3], rows[1::3] = rows[1::3].copy(), rows[:-1:3].copy()
    path = ouster(tmp_path / "leap.pcap", [packet.tobytes() for packet in table[rows]])
    assert np.abs(read_recording(path)["timestamp"] - whole["timestamp"]).max() < 3e-6
    late, leap = lines(path, caplog)
    assert late == "sorted by the sensor's clock, as 85 packets are late"
    assert leap.startswith("the sensor's clock leaps (at packet 100: -0.1984 s)")

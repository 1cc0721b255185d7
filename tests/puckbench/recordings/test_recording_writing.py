"""Our scans as packet captures: what comes back from them."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.lidar.return_table import ReturnTable
from pointkit.lidar.sensors import load_sensor
from puck.recordings.packet_turns import decode_packets
from puck.recordings.packets import PACKET
from puckbench.recordings.reading import read_recording
from puckbench.recordings.writing import distance_counts, scan_packets, write_pcap
from tests.support.sensor_scenes import ROOM, room
from virtual_lidar import ScanTable, open_error_model, open_sweep, scan

SPIN = {"duration_s": 0.4, "pitch_start_deg": 0.0, "pitch_end_deg": 0.0, "azimuth_step_deg": 2.0}


@pytest.fixture(scope="module")
def table() -> ScanTable:
    sensor, model = load_sensor("vlp16"), open_error_model("vlp16")
    return scan(room(), sensor, open_sweep(SPIN), model, ROOM / 2, np.random.default_rng(0))


@pytest.fixture
def read(table: ScanTable, tmp_path: Path) -> ReturnTable:
    write_pcap(tmp_path / "a.pcap", table)
    return read_recording(tmp_path / "a.pcap")


def as_fired_clockwise(table: ScanTable) -> ScanTable:
    """The rows in the order of a clockwise sensor: turn, azimuth, laser."""
    turn = np.rint(table["timestamp"] * 5 - table["yaw"] / (2 * np.pi))
    azimuth = np.rint(np.degrees(-table["yaw"]) * 100) % 36000
    return table.select(np.lexsort((table["laser_id"], azimuth, turn)))


def test_every_return_comes_back(table: ScanTable, read: ReturnTable) -> None:
    rows = as_fired_clockwise(table)
    assert read["laser_id"].tolist() == rows["laser_id"].tolist()
    # Half the unit of 2 mm.
    assert np.abs(read["distance"] - rows["distance_noisy"]).max() <= 1.0e-3 + 1e-12
    turned = np.mod(read["azimuth"] + rows["yaw"] + np.pi, 2 * np.pi) - np.pi
    assert np.abs(np.degrees(turned)).max() < 0.0051
    assert np.abs(read["elevation"] - rows["pitch"]).max() < 1e-12


def test_lasers_that_fire_one_after_another_come_back_at_their_own_azimuths() -> None:
    sensor, model = load_sensor("vlp16"), open_error_model("vlp16")
    level = {key: SPIN[key] for key in ("pitch_start_deg", "pitch_end_deg")}
    sweep = open_sweep({**level, "duration_s": 0.01, "rotation_hz": 10.0, "timing": "firing"})
    table = scan(room(), sensor, sweep, model, ROOM / 2, np.random.default_rng(0))
    read, rows = decode_packets(scan_packets(table).payloads), as_fired_clockwise(table)
    turned = np.mod(read["azimuth"] + rows["yaw"] + np.pi, 2 * np.pi) - np.pi
    assert read["laser_id"].tolist() == rows["laser_id"].tolist()
    assert len(np.unique(rows["yaw"])) == len(rows)
    assert np.abs(np.degrees(turned)).max() < 0.0051


def test_points_of_a_level_spin_come_back(table: ScanTable, read: ReturnTable) -> None:
    correction = np.asarray(load_sensor("vlp16").vertical_correction_mm) / 1000
    level = read.xyz
    level[:, 2] -= correction[read["laser_id"]]
    expected = as_fired_clockwise(table).xyz_noisy - ROOM / 2
    assert np.abs(level - expected).max() < 1.0e-3 + np.radians(0.0051) * 4


def test_time_runs_on_by_the_turn(read: ReturnTable) -> None:
    assert read["turn"].max() == 1
    ideal = (read["turn"] + read["azimuth"] / (2 * np.pi)) / 5
    # A column takes four of the real sensor's firing times, six columns share a packet's stamp.
    late = read["timestamp"] - ideal - (read["timestamp"][0] - ideal[0])
    assert np.abs(late).max() < 6 / 180 / 5


def test_clean_distances_on_demand(table: ScanTable) -> None:
    noisy, clean = scan_packets(table), scan_packets(table, noisy=False)
    assert not np.array_equal(noisy.payloads, clean.payloads)


def test_reflectivity_is_written_where_the_scan_has_it(table: ScanTable) -> None:
    bright = replace(table, columns={**table.columns, "reflectivity": np.full(len(table), 0.37)})
    assert set(decode_packets(scan_packets(bright).payloads)["reflectivity"]) == {37}
    assert set(decode_packets(scan_packets(table).payloads)["reflectivity"]) == {100}


def test_the_ip_header_has_a_valid_checksum(table: ScanTable, tmp_path: Path) -> None:
    write_pcap(tmp_path / "a.pcap", table)
    words = struct.unpack(">10H", (tmp_path / "a.pcap").read_bytes()[54:74])
    total = sum(words)
    assert (total & 0xFFFF) + (total >> 16) == 0xFFFF


def test_the_first_firing_of_every_second_block_has_the_returns(table: ScanTable) -> None:
    packets = scan_packets(table).payloads.view(PACKET)
    blocks = packets["blocks"]["returns"]["distance"].reshape(-1, 2, 2, 16)
    assert np.count_nonzero(blocks[:, 0, 0]) == len(table)
    assert not blocks[:, 1].any()
    assert not blocks[:, 0, 1].any()


def test_distances_fill_sixteen_bits() -> None:
    counts = distance_counts(np.array([0.0009, 0.0011, 131.07, 131.072, np.inf]))
    assert counts.tolist() == [0, 1, 65535, 0, 0]


def test_a_return_out_of_the_packets_range_is_left_out(table: ScanTable) -> None:
    far = table["distance_noisy"].copy()
    far[:10] = [0.0005, -0.01, 131.2, 500, *[2.0] * 6]
    moved = replace(table, columns={**table.columns, "distance_noisy": far})
    assert scan_packets(moved).about["returns"] == len(table) - 4


def test_a_scan_by_another_sensor_is_refused(table: ScanTable, tmp_path: Path) -> None:
    sensor = {**table.about["sensor"], "name": "Other", "laser_elevation_deg": [0.0]}
    other = replace(table, about={**table.about, "sensor": sensor})
    with pytest.raises(InputError, match="a scan by Other cannot be written"):
        write_pcap(tmp_path / "a.pcap", other)
    assert not list(tmp_path.iterdir())

"""Lasers of an unknown sensor are found in clouds of a ROS bag, and give returns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.lidar.return_table import ReturnTable
from pointkit.lidar.sensors import load_sensor
from puckbench.cli import main
from puckbench.recordings.reading import read_recording
from tests.support.cloud_bags import Rows, cloud_bag

SENSOR = load_sensor("vlp32c")
ELEVATIONS = np.array(SENSOR.laser_elevation_deg)
HEIGHTS_M = np.array(SENSOR.vertical_correction_mm) / 1000
AZIMUTHS_DEG = np.array(SENSOR.laser_azimuth_deg)
BY_RANK = np.argsort(ELEVATIONS)
COLUMNS, NOISE_M = 600, 0.005
RINGS = np.arange(32)
TILT = np.radians(20)
_UP = np.array([0.0, -np.sin(TILT), np.cos(TILT)])
_SIDE = np.array([0.0, np.cos(TILT), np.sin(TILT)])
_AHEAD = np.array([1.0, 0.0, 0.0])
WALLS = np.stack([_AHEAD, -_AHEAD, _SIDE, -_SIDE, _UP, -_UP], axis=1)
"""Normals of the walls of a room, in which the sensor is tilted: each laser sees many ranges."""
WALLS_M = np.array([9.0, 6.0, 5.0, 4.0, 2.5, 1.5])


def turn(seed: int, rings: Rows = RINGS) -> Rows:
    """A turn of a VLP-32C in an empty room, in ROS's frame: x forward, y left."""
    random = np.random.default_rng(seed)
    laser, column = np.tile(BY_RANK, COLUMNS), np.repeat(np.arange(COLUMNS), 32)
    seconds = column * 0.1 / COLUMNS
    clockwise = np.radians(AZIMUTHS_DEG[laser]) + 2 * np.pi * seconds / 0.1
    up = np.radians(ELEVATIONS[laser])
    rays = np.stack(
        [np.cos(up) * np.cos(clockwise), -np.cos(up) * np.sin(clockwise), np.sin(up)], axis=1
    )
    start = np.zeros_like(rays)
    start[:, 2] = HEIGHTS_M[laser]
    facing, distance = rays @ WALLS, WALLS_M - start @ WALLS
    distance = np.divide(distance, facing, out=np.full_like(facing, np.inf), where=facing > 1e-6)
    distance = distance.min(axis=1) + random.normal(0, NOISE_M, len(rays))
    points = start + rays * distance[:, None]
    kinds = [*((axis, "<f4") for axis in "xyz"), ("ring", "<u2"), ("time", "<f4")]
    rows = np.zeros(len(rays), kinds)
    for place, axis in enumerate("xyz"):
        rows[axis] = points[:, place]
    rows["ring"], rows["time"] = np.tile(rings, COLUMNS), seconds
    return rows


def recorded(path: Path, turns: list[Rows]) -> ReturnTable:
    return read_recording(cloud_bag(path, {"/points": turns}))


@pytest.mark.parametrize("rings", [RINGS, RINGS[::-1] + 5])
def test_lasers_of_a_virtual_scan_are_found(tmp_path: Path, rings: Rows) -> None:
    """Rings may be numbered from above, and from any number."""
    turns = [turn(seed, rings=rings) for seed in range(2)]
    table = recorded(tmp_path / "a.mcap", turns)
    assert np.array_equal(table["laser_id"], np.tile(np.arange(32), 2 * COLUMNS))
    about = table.about
    assert np.abs(about["laser_elevation_deg"] - ELEVATIONS[BY_RANK]).max() < 0.02
    assert np.abs(about["vertical_correction_mm"] - 1000 * HEIGHTS_M[BY_RANK]).max() < 2
    azimuths = AZIMUTHS_DEG[BY_RANK] - AZIMUTHS_DEG.mean()
    assert np.abs(about["laser_azimuth_deg"] - azimuths).max() < 0.02
    assert about["laser_fit_rms_mm"] < 0.05
    named = read_recording(tmp_path / "a.mcap", sensor=SENSOR) if rings[0] == 0 else table
    assert np.abs(named["distance"] - table["distance"]).max() < 0.005
    assert np.array_equal(named["timestamp"], table["timestamp"])


def test_residuals_are_those_of_moved_points(tmp_path: Path) -> None:
    """Points that lie up to 20 mm above or below their cones, as after a correction for motion."""
    rows = turn(0)
    off = np.random.default_rng(1).uniform(-0.02, 0.02, len(rows))
    rows["z"] += off.astype(np.float32)
    about = recorded(tmp_path / "a.bag", [rows]).about
    across = 1000 * off * np.cos(np.radians(ELEVATIONS[np.tile(BY_RANK, COLUMNS)]))
    assert about["laser_fit_rms_mm"] == pytest.approx(np.sqrt(np.mean(across**2)), rel=0.02)


def test_rare_rings_are_left_out_and_clouds_without_times_have_no_azimuths(tmp_path: Path) -> None:
    rows = turn(0)
    rows = np.concatenate([rows[rows["ring"] > 0], rows[rows["ring"] == 0][:5]])
    rows["time"] = 0
    table = recorded(tmp_path / "a.db3", [rows])
    assert table.about["points_left_out"] == 5
    assert len(table) == 31 * COLUMNS
    assert "laser_azimuth_deg" not in table.about


def test_what_is_no_spinning_sensor_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = turn(0)
    path = cloud_bag(tmp_path / "a.mcap", {"/points": [rows[:60]]})
    assert main(["capture", str(path), str(tmp_path / "a.parquet")]) == 2
    message = capsys.readouterr().err
    assert "a.mcap: topic /points: no laser has 16 points" in message
    rows["ring"] = np.random.default_rng(0).permutation(rows["ring"])
    with pytest.raises(InputError, match="degrees off its cone"):
        recorded(tmp_path / "b.mcap", [rows])

"""Tables of returns from clouds (PointCloud2) with lasers and times, as drivers publish them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cloud_files.clouds import read_cloud
from pointkit.errors import InputError
from pointkit.lidar.return_table import ReturnTable, read_return_table
from pointkit.lidar.sensors import load_sensor
from puckbench.cli import main
from puckbench.recordings.reading import read_recording
from tests.support.cloud_bags import FORMATS, Rows, cloud_bag
from tests.support.cloud_turns import RANKS, SINCE_S, bag, turns

SENSOR = load_sensor("vlp16")
ELEVATIONS = np.asarray(SENSOR.laser_elevation_deg)
BY_RANK = np.argsort(ELEVATIONS)
COLUMNS, PERIOD_S, STAMP_S = 90, 0.1, 1.7e9
TIMES: dict[str, tuple[str, str, float, bool]] = {
    "velodyne": ("time", "<f4", 1.0, False),
    "ouster": ("t", "<u4", 1e9, False),
    "hesai": ("timestamp", "<f8", 1.0, True),
    "livox": ("offset_time", "<u4", 1e9, False),
    "nanoseconds": ("timestamp", "<f8", 1e9, True),
}
"""Field, type, ticks per second, and whether times are since 1970, by driver."""


def turn(driver: str, laser: str = "ring", number: int = 0) -> Rows:
    """A turn of a VLP-16 in ROS's frame: x forward, y left."""
    name, kind, ticks, is_absolute = TIMES[driver]
    rows = np.zeros(
        COLUMNS * 16,
        [*((axis, "<f4") for axis in "xyz"), (laser, "<u2"), (name, kind), ("intensity", "<f4")],
    )
    rank = np.tile(np.arange(16), COLUMNS)
    clockwise = np.repeat(np.arange(COLUMNS), 16) / COLUMNS * 2 * np.pi
    elevation, distance = np.radians(ELEVATIONS[BY_RANK][rank]), 5.0 + number
    rows["x"] = distance * np.cos(elevation) * np.cos(clockwise)
    rows["y"] = -distance * np.cos(elevation) * np.sin(clockwise)
    rows["z"] = distance * np.sin(elevation)
    rows[laser], rows["intensity"] = rank, 7
    seconds = clockwise / (2 * np.pi) * PERIOD_S
    absolute = STAMP_S + PERIOD_S * number if is_absolute else 0.0
    rows[name] = (absolute + seconds) * ticks
    return rows


def returns_of(path: Path, turns: list[Rows], **options: Any) -> ReturnTable:
    stamps = [STAMP_S + PERIOD_S * number for number in range(len(turns))]
    return read_recording(cloud_bag(path, {"/points": turns}, stamps), **options)


@pytest.mark.parametrize("form", FORMATS)
def test_a_turn_is_a_message_in_the_frame_of_the_sensor(tmp_path: Path, form: str) -> None:
    turns = [turn("velodyne", number=number) for number in range(3)]
    table = returns_of(tmp_path / f"a.{form}", turns, sensor=SENSOR)
    assert table["turn"].tolist() == np.repeat([0, 1, 2], COLUMNS * 16).tolist()
    assert table["laser_id"].tolist() == np.tile(BY_RANK, 3 * COLUMNS).tolist()
    assert table["distance"] == pytest.approx(np.repeat([5.0, 6.0, 7.0], COLUMNS * 16), abs=1e-5)
    azimuths = np.repeat(np.arange(COLUMNS), 16) / COLUMNS * 2 * np.pi
    off = np.mod(table["azimuth"] - np.tile(azimuths, 3) + np.pi, 2 * np.pi) - np.pi
    assert np.abs(off).max() < 1e-6
    assert set(table["reflectivity"]) == {7}
    about = {"sensor": "VLP-16", "topic": "/points", "messages": 3, "source": f"a.{form}"}
    assert table.about.items() >= about.items()


@pytest.mark.parametrize("driver", TIMES)
@pytest.mark.parametrize("laser", ["ring", "channel", "line"])
def test_times_of_drivers_are_seconds_since_the_first(
    tmp_path: Path, driver: str, laser: str
) -> None:
    turns = [turn(driver, laser, number) for number in range(3)]
    table = returns_of(tmp_path / "a.mcap", turns, sensor=SENSOR)
    column = np.repeat(np.arange(3 * COLUMNS), 16)
    assert table["timestamp"] == pytest.approx(column / COLUMNS * PERIOD_S, abs=1e-6)


def test_a_unit_can_be_named(tmp_path: Path) -> None:
    few = turn("hesai")[:3]
    few["timestamp"] = [0, 1000, 2000]
    table = returns_of(tmp_path / "a.mcap", [few], sensor=SENSOR, time_unit="us")
    assert table["timestamp"].tolist() == [0, 0.001, 0.002]


def test_messages_without_points_are_passed_over_and_missing_returns_counted(
    tmp_path: Path,
) -> None:
    rows = turn("velodyne")
    for axis in "xyz":
        rows[axis][:40] = np.nan
    table = returns_of(tmp_path / "a.bag", [rows[:0], rows[:40], rows], sensor=SENSOR)
    assert set(table["turn"]) == {2}
    assert len(table) == COLUMNS * 16 - 40
    assert table["timestamp"].min() == 0
    assert table.about["missing_returns"] == 40


def test_an_interval_is_taken_by_time(tmp_path: Path) -> None:
    turns = [turn("ouster", number=number) for number in range(3)]
    table = returns_of(tmp_path / "a.bag", turns, sensor=SENSOR, start_s=0.15, end_s=0.2)
    assert set(table["turn"]) == {1}


def test_what_is_lacking_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    turns = [turn("velodyne")]
    path = cloud_bag(tmp_path / "a.bag", {"/points": turns, "/others": turns})
    out = str(tmp_path / "a.parquet")
    assert main(["capture", str(path), out, "--sensor", "vlp16", "--topic", "/others"]) == 0
    assert len(read_return_table(Path(out))) == COLUMNS * 16
    faults = {
        ("--sensor", "vlp16"): "several topics of sensor_msgs/msg/PointCloud2: /others, /points",
        ("--sensor", "vlp16", "--topic", "/up"): "has no topic /up; it has /others, /points",
    }
    capsys.readouterr()
    for options, fault in faults.items():
        assert main(["capture", str(path), out, *options]) == 2
        message = capsys.readouterr().err
        assert message.startswith(f"puckbench: {path}: ")
        assert fault in message
    fields = {"ring": "no laser column", "x": "no field x"}
    for field, fault in fields.items():
        rest = turns[0][[name for name in turns[0].dtype.names or () if name != field]]
        with pytest.raises(InputError, match=f"{field}.mcap: topic /points: {fault}"):
            returns_of(tmp_path / f"{field}.mcap", [rest], sensor=SENSOR)
    with pytest.raises(InputError, match="no points in its messages"):
        returns_of(tmp_path / "b.mcap", [turns[0][:0]], sensor=SENSOR)
    with pytest.raises(InputError, match=r"topic '/up': only ROS bags have topics"):
        read_recording(Path(out), topic="/up")


@pytest.mark.parametrize("driver", TIMES)
def test_messages_are_exported_with_ring_intensity_and_seconds(tmp_path: Path, driver: str) -> None:
    turns = [turn(driver, number=number) for number in range(3)]
    turns[1]["x"][5:9] = turns[1]["y"][5:9] = turns[1]["z"][5:9] = np.nan
    stamps = [STAMP_S + PERIOD_S * number for number in range(3)]
    bag = cloud_bag(tmp_path / "a.mcap", {"/one": turns[:1], "/two": turns}, stamps)
    out = tmp_path / "a.pcd"
    assert main(["export", str(bag), str(out), "--topic", "/two", "--turns", "1-2"]) == 0
    cloud = read_cloud(out)
    rows = np.concatenate([np.delete(turns[1], range(5, 9)), turns[2]])
    assert np.array_equal(cloud.xyz, np.column_stack([rows[axis] for axis in "xyz"]))
    assert np.array_equal(cloud.fields["ring"], rows["ring"])
    assert np.array_equal(cloud.fields["intensity"], rows["intensity"])
    seconds = np.repeat(np.arange(2 * COLUMNS), 16) / COLUMNS * PERIOD_S
    assert cloud.fields["time"] == pytest.approx(np.delete(seconds, range(5, 9)), abs=1e-6)


def test_messages_without_lasers_are_exported_as_points(tmp_path: Path) -> None:
    rows = np.zeros(4, [(axis, "<f4") for axis in "xyz"])
    rows["x"] = np.arange(1, 5)
    bag = cloud_bag(tmp_path / "a.db3", {"/points": [rows]})
    for suffix in (".pcd", ".las", ".bin", ".csv", ".ply"):
        assert main(["export", str(bag), str(tmp_path / f"a{suffix}")]) == 0
        points = read_cloud(tmp_path / f"a{suffix}").xyz
        assert points[:, 0].tolist() == [1, 2, 3, 4]


def test_what_cannot_be_exported_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = cloud_bag(tmp_path / "a.mcap", {"/points": [turn("velodyne")]})
    for words, fault in {
        ("a.pcd", "--turns", "1"): "a.mcap: topic /points: has messages 0 to 0, not 1 to 1",
        ("a.pcd", "--topic", "/other"): "a.mcap: the ROS bag has no topic /other; it has /points",
        ("a.pcap",): "a.pcap: a recording has no true coordinates and no scan's columns",
    }.items():
        assert main(["export", str(bag), str(tmp_path / words[0]), *words[1:]]) == 2
        assert fault in capsys.readouterr().err


def told(path: Path, caplog: pytest.LogCaptureFixture) -> list[str]:
    return [line.removeprefix(f"{path}: topic /points: ") for line in caplog.messages]


@pytest.mark.parametrize("sensor", [None, SENSOR], ids=["fitted", "named"])
@pytest.mark.parametrize(
    ("intensity", "seen"),
    [(-1, "-1 to -1"), (0.5, "0.5 to 0.5"), (4000, "4000 to 4000"), (np.nan, "nan")],
)
def test_intensities_that_are_no_reflectivities_are_unknown(
    intensity: float, seen: str, sensor: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = bag(tmp_path / "a.mcap", turns(2, intensity=intensity))
    assert set(read_recording(path, sensor)["reflectivity"]) == {-1}
    fault = f"column intensity has {seen}, which are no reflectivities from 0 to 255: left out (-1)"
    assert told(path, caplog) == [fault]


@pytest.mark.parametrize(
    ("ring", "kind"),
    [
        (RANKS + 1, "<u2"),
        (RANKS, "<f4"),
        (15 - RANKS, "i1"),
        (np.random.default_rng(0).permutation(16)[RANKS], "u1"),
    ],
    ids=["from_1", "float", "from_the_highest", "unordered"],
)
def test_fitted_lasers_are_numbered_by_elevation_whatever_their_rings(
    ring: Any, kind: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    table = read_recording(bag(tmp_path / "a.mcap", turns(2, ring=ring, ring_kind=kind)))
    assert table["laser_id"].tolist() == np.tile(RANKS, 2).tolist()
    assert not caplog.messages


NOT_FINITE = np.where(np.arange(len(RANKS)) == 5, np.nan, RANKS)


@pytest.mark.parametrize(
    ("ring", "kind", "fitted", "named"),
    [
        (None, "", "no laser column", "no laser column"),
        (RANKS + 1, "<u2", None, "column ring has a value that is not a laser of the VLP-16: 16,"),
        (RANKS[::-1], "<u2", None, "points of laser 15 lie 29.9 degrees off its cone"),
        (NOT_FINITE, "<f4", "field ring has a value that is not finite", "VLP-16: nan, not 0 to"),
        (RANKS + 0.5, "<f4", "field ring has 0.5, no laser's number", "VLP-16: 0.5, not 0 to 15"),
        (np.arange(1024), "<u2", "field ring has 1,024 numbers, more than 128", "VLP-16: 16, not"),
        (
            RANKS + 16 * (SINCE_S > 0.05),
            "<u2",
            "lasers 0 and 16 have the same elevation: -15",
            "VLP-16: 16, not 0 to 15",
        ),
    ],
    ids=["none", "from_1", "reversed", "nan", "half", "numbers", "more"],
)
def test_rings_that_are_no_lasers_are_refused(
    ring: Any, kind: str, fitted: str | None, named: str, tmp_path: Path
) -> None:
    path = bag(tmp_path / "a.mcap", turns(2, ring=ring, ring_kind=kind))
    for sensor, fault in ((None, fitted), (SENSOR, named)):
        if fault is None:
            assert len(read_recording(path, sensor)) == 2 * len(RANKS)
            continue
        with pytest.raises(InputError) as refusal:
            read_recording(path, sensor)
        assert str(refusal.value).startswith(f"{path}: topic /points: ")
        assert fault in str(refusal.value)


def test_points_of_two_sensors_in_a_message_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    left, right = turns(1)[0], turns(1)[0]
    right["y"] -= 1
    path = bag(tmp_path / "a.mcap", [np.concatenate([left, right])])
    read_recording(path, SENSOR)
    fault = "column ring: 32% of the points lie more than 0.5 degrees off the cones of their lasers"
    assert told(path, caplog) == [fault]


def test_rings_of_few_points_are_left_out_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = bag(tmp_path / "a.mcap", turns(1, ring=np.where(np.arange(1024) < 5, 77, RANKS)))
    assert read_recording(path).about["points_left_out"] == 5
    assert told(path, caplog) == ["left out 5 points of lasers with few points"]


def test_a_compressed_bag_is_named_and_not_its_copy(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = bag(tmp_path / "a.mcap", turns(1, intensity=-1))
    assert main(["compress", str(path), str(tmp_path / "b.puck")]) == 0
    caplog.clear()
    assert main(["capture", str(tmp_path / "b.puck"), str(tmp_path / "a.parquet")]) == 0
    (line,) = caplog.messages
    assert line.startswith(f"{tmp_path / 'b.puck'}: topic /points: column intensity")


@pytest.mark.parametrize(
    ("intensity", "suffix", "stored", "told"),
    [
        (7, ".bin", 7 / 255, None),
        (0.25, ".bin", 0.25, None),
        (
            -3,
            ".bin",
            -3,
            "intensities from -3 to -3 remain as they are, as they are none from 0 to 255",
        ),
        (
            4000,
            ".bin",
            4000,
            "intensities from 4000 to 4000 remain as they are, as they are none from",
        ),
        (7, ".las", 7, None),
        (4000, ".las", 4000, None),
        (0.25, ".las", 16384, "intensities from 0.25 to 0.25 are multiplied by 65535"),
        (-3, ".las", 0, "intensities from -3 to -3 become whole numbers from 0 to 65535"),
    ],
)
def test_intensities_that_a_format_cannot_have_are_told(
    intensity: float,
    suffix: str,
    stored: float,
    told: str | None,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    path, out = bag(tmp_path / "a.mcap", turns(1, intensity=intensity)), tmp_path / f"a{suffix}"
    assert main(["export", str(path), str(out)]) == 0
    values = read_cloud(out).fields.get("intensity", np.zeros(1))
    assert values == pytest.approx(np.full(len(values), stored))
    assert len(caplog.messages) == (told is not None)
    assert all(line.startswith(f"{out}: {told}") for line in caplog.messages)

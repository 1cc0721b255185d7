"""Clouds with lasers as capture tables: our own exports, other decoders' columns, damage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cloud_files.pcd import parse_pcd
from pointkit.errors import InputError
from pointkit.lidar.sensors import load_sensor
from pointkit.lidar.times import TimeUnit, seconds_of, unit_of
from puckbench.recordings.export import export
from puckbench.recordings.reading import read_recording

DATA = Path(__file__).parents[2] / "data" / "capture"
HEADER = """# .PCD v0.7
VERSION 0.7
FIELDS x y z _ ring
SIZE 4 4 4 1 2
TYPE F F F U U
COUNT 1 1 1 3 1
WIDTH 2
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 2
"""
LOW, HIGH = 5 * np.tan(np.radians(-15)), 2 * np.tan(np.radians(15))
ROWS = np.array(
    [(3.0, 4.0, LOW, 0, 0), (0.0, -2.0, HIGH, 0, 15)],
    dtype=[("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("_", "u1", 3), ("ring", "<u2")],
)
BINARY = HEADER.encode() + b"DATA binary\n" + ROWS.tobytes()
PLAIN = b"".join(ROWS[name].tobytes() for name in ROWS.dtype.names or ())
# One literal run of LZF: its length less one, then its bytes.
PACKED = bytes([31]) + PLAIN[:32] + bytes([len(PLAIN) - 33]) + PLAIN[32:]
COMPRESSED = (
    HEADER.encode()
    + b"DATA binary_compressed\n"
    + len(PACKED).to_bytes(4, "little")
    + len(PLAIN).to_bytes(4, "little")
    + PACKED
)
ASCII = HEADER.encode() + b"DATA ascii\n3 4 -1.34 0 0 0 0\n0 -2 0.536 0 0 0 15\n"


@pytest.mark.parametrize("suffix", [".csv", ".ply", ".pcd"])
def test_an_exported_capture_comes_back(tmp_path: Path, suffix: str) -> None:
    table = read_recording(DATA / "single.pcap")
    export(tmp_path / f"a{suffix}", table)
    again = read_recording(tmp_path / f"a{suffix}")
    assert again.about["format"] == suffix[1:]
    # PCD has single precision, and neither knows the vertical correction's share of z.
    assert again.xyz == pytest.approx(table.xyz, abs=1e-6)
    assert again["distance"] == pytest.approx(table["distance"], abs=1e-6)
    assert again["laser_id"].tolist() == table["laser_id"].tolist()
    assert again["timestamp"].tolist() == table["timestamp"].tolist()


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_las_comes_back_to_a_tenth_of_a_millimetre(tmp_path: Path, suffix: str) -> None:
    table = read_recording(DATA / "single.pcap")
    export(tmp_path / f"a{suffix}", table)
    again = read_recording(tmp_path / f"a{suffix}")
    assert np.abs(again.xyz - table.xyz).max() <= 0.5e-4 + 1e-9
    for name in ("laser_id", "timestamp", "reflectivity"):
        assert again[name].tolist() == table[name].tolist()
    data = bytearray((tmp_path / f"a{suffix}").read_bytes())
    for at in (len(data) // 2, 300, 100):
        (tmp_path / f"b{suffix}").write_bytes(data[:at])
        with pytest.raises(InputError, match=f"b{suffix}: "):
            read_recording(tmp_path / f"b{suffix}")
    data[107:111] = b"\xff\xff\xff\xff"
    (tmp_path / f"b{suffix}").write_bytes(data)
    with pytest.raises(InputError, match=f"b{suffix}: "):
        read_recording(tmp_path / f"b{suffix}")


@pytest.mark.parametrize("data", [BINARY, ASCII, COMPRESSED])
def test_rings_count_lasers_by_elevation(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "a.pcd").write_bytes(data)
    table = read_recording(tmp_path / "a.pcd")
    elevations = np.asarray(load_sensor("vlp16").laser_elevation_deg)[table["laser_id"]]
    assert elevations.tolist() == [-15, 15]
    assert table["azimuth"] == pytest.approx([np.arctan2(3, 4), np.pi])
    assert table["distance"] == pytest.approx(np.array([5, 2]) / np.cos(np.radians(15)))


def with_intensities(path: Path, values: list[float]) -> Path:
    lines = [f"3,4,{LOW},0,{value}" for value in values]
    path.write_text("\n".join(["x,y,z,laser_id,intensity", *lines]) + "\n")
    return path


def test_reflectivities_are_rounded_into_one_byte(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for values in ([0, 0.4, 99.6, 254.7, 255], [0, 1, 1, 0], [1]):
        path = with_intensities(tmp_path / "a.csv", values)
        assert read_recording(path)["reflectivity"].tolist() == np.rint(values).tolist()
    assert not caplog.messages


@pytest.mark.parametrize(
    ("values", "seen"),
    [
        ([-3.0, 7], "-3 to 7"),
        ([0, 0.25, 1], "0 to 1"),
        ([0.125], "0.125 to 0.125"),
        ([12, 255.5], "12 to 255.5"),
        ([0, 65535], "0 to 65535"),
        ([7, float("nan")], "7 to 7 and nan"),
        ([float("nan")], "nan"),
        ([7, float("inf")], "7 to inf"),
    ],
)
def test_intensities_that_are_no_reflectivities_are_unknown_and_told(
    values: list[float], seen: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = with_intensities(tmp_path / "a.csv", values)
    assert set(read_recording(path)["reflectivity"]) == {-1}
    fault = f"column intensity has {seen}, which are no reflectivities from 0 to 255: left out (-1)"
    assert caplog.messages == [f"{path}: {fault}"]


@pytest.mark.parametrize("laser", ["-1", "16", "2.5", ""])
@pytest.mark.parametrize("column", ["laser_id", "laser", "label", "ring", "channel"])
def test_a_laser_is_a_whole_number_that_the_sensor_has(
    tmp_path: Path, column: str, laser: str
) -> None:
    (tmp_path / "a.csv").write_text(f"x,y,z,{column}\n1,2,3,15\n1,2,3,{laser}\n")
    with pytest.raises(InputError, match=f"column {column} has a value that is not a laser"):
        read_recording(tmp_path / "a.csv")


def test_an_interval_of_a_cloud_is_taken_by_time(tmp_path: Path) -> None:
    export(tmp_path / "a.csv", read_recording(DATA / "single.pcap"))
    assert read_recording(tmp_path / "a.csv", start_s=0.001)["timestamp"].min() >= 0.001


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.csv", b"", "the cloud is empty"),
        ("a.csv", b"x,y,z\n1,2,3\n", "no laser column"),
        ("a.csv", b"x,y,ring\n1,2,3\n", "no column z"),
        ("a.csv", b"x,y,z,ring\n1,2,oops,3\n", "column z has 'oops'"),
        ("a.csv", b"x,y,z,ring\n1,2,3,16\n", "column ring has a value that is not a laser"),
        ("a.csv", b"x,y,z,ring\n1,2,,1\n1,2,3,1\n", "not finite"),
        ("a.csv", b"x,y,z,ring\n", "the cloud is empty"),
        ("a.ply", b"ply\nformat oops\n", "not a readable PLY"),
        ("a.pcd", b"oops", "not a PCD file"),
        ("a.pcd", BINARY[:-10], "has 1 points, but its header says 2"),
        ("a.pcd", BINARY.replace(b"TYPE F", b"TYPE Q"), "not a readable PCD header"),
        ("a.pcd", BINARY.replace(b"COUNT 1", b"COUNT 0"), "no column x"),
        ("a.pcd", BINARY.replace(b"COUNT 1", b"COUNT 99999999"), "not a readable PCD header"),
        ("a.pcd", BINARY.replace(b"binary", b"binary_zipped"), "form binary_zipped"),
        ("a.pcd", COMPRESSED[:-2], "damaged compressed points"),
        ("a.pcd", COMPRESSED.replace(b"POINTS 2", b"POINTS 99999999999"), "bytes for \\d+ points"),
        ("a.las", b"LASF", "not a readable LAS"),
        ("a.laz", b"LASF" + bytes(400), "not a readable LAS"),
        ("a.pcd", ASCII.replace(b"1.34", b"1,34"), "damaged line"),
    ],
)
def test_damage_is_one_line_that_names_the_file(
    tmp_path: Path, name: str, data: bytes, message: str
) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=f"{name}: .*{message}"):
        read_recording(tmp_path / name)


@pytest.mark.parametrize("suffix", [".csv", ".ply", ".pcd", ".las"])
def test_a_missing_cloud_is_named(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(InputError, match=f"a{suffix}: no such file"):
        read_recording(tmp_path / f"a{suffix}")


@pytest.mark.parametrize("turned_deg", [0.2, 1.0, 29.9])
@pytest.mark.parametrize(
    ("rate_hz", "ticks", "unit"),
    [
        *(
            (rate, ticks, unit)
            for rate in (0.35, 5, 20, 300)
            for ticks, unit in ((1e9, "ns"), (1e6, "us"), (1e3, "ms"), (1.0, "s"))
        ),
        (0.3, 1e9, None),
        (330, 1.0, None),
    ],
)
def test_units_are_those_with_which_the_sensor_turns(
    rate_hz: float, ticks: float, unit: str | None, turned_deg: float
) -> None:
    azimuth = np.radians(np.mod(turned_deg * np.arange(40) + 123, 360))
    times = turned_deg / 360 / rate_hz * ticks * np.arange(40)
    number_unit = unit or ("s" if ticks == 1 else None)
    assert unit_of(times, azimuth) == number_unit
    assert unit_of(times[::-1], azimuth[::-1]) == number_unit
    if ticks == 1e9:
        assert unit_of(np.rint(times).astype(np.uint64), azimuth) == unit


def test_azimuths_that_show_no_turning_tell_no_unit() -> None:
    random = np.random.default_rng(1)
    times, azimuth = np.arange(100) * 1000, random.uniform(0, 2 * np.pi, 100)
    assert unit_of(times, azimuth) is None
    assert unit_of(times, np.zeros(100)) is None
    assert unit_of(times[:8], np.arange(8) * 0.1) is None
    assert unit_of(times[:9], np.arange(9) * 0.1) is not None
    assert unit_of(times.astype(float), azimuth) is None
    assert unit_of(times / 1000, azimuth) == "s"
    for unit, ticks in (("s", 1), ("ms", 10**3), ("us", 10**6), ("ns", 10**9)):
        assert unit_of(times * (ticks / times.max() / 10), azimuth, turn_s=0.1) == unit
    # Of ten steps six are across the sensor.
    leaps = np.cumsum([0, *[0.1] * 40, *[2.0] * 60])
    assert unit_of(np.arange(101) * 1000, leaps) is None


@pytest.mark.parametrize(("ticks", "unit"), [(1, "s"), (10**3, "ms"), (10**6, "us"), (10**9, "ns")])
def test_times_since_1970_tell_their_unit(ticks: int, unit: TimeUnit) -> None:
    still = np.zeros(2)
    for first in (946_684_800, 1_700_000_000, 4_102_444_800 - 86_401):
        times = np.array([first, first + 86_400], dtype=np.int64) * ticks
        assert unit_of(times, still) == unit
        assert seconds_of(times, unit).tolist() == [0, 86_400]
        assert seconds_of(times.astype(float), unit).tolist() == [0, 86_400]
    for times in ([946_684_799, 946_684_800], [4_102_444_799, 4_102_444_800]):
        assert unit_of(np.array(times) * ticks, still) is None
    assert unit_of(np.array([1_700_000_000, 1_700_086_401]) * ticks, still) is None


@given(
    st.sampled_from([BINARY, ASCII, COMPRESSED]),
    st.lists(st.tuples(st.integers(0, 260), st.integers(0, 255)), max_size=5),
    st.integers(0, 260),
)
@settings(max_examples=300)
def test_a_mutated_pcd_is_columns_or_an_error(
    data: bytes, changes: list[tuple[int, int]], length: int
) -> None:
    changed = bytearray(data)
    for at, value in changes:
        changed[at % len(changed)] = value
    try:
        columns = parse_pcd(bytes(changed[:length] if length < 100 else changed))
    except InputError:
        return
    assert all(len(column) <= len(data) for column in columns.values())


def ring_of_turns(path: Path, times: list[Any], lasers: Any = None) -> Path:
    """Points of a VLP-16 at 10 Hz, 4 degrees apart, at 4 m on all lasers in turn."""
    count = len(times)
    ids = np.arange(count) % 16 if lasers is None else lasers
    azimuth = np.radians(4 * np.arange(count))
    z = 4 * np.tan(np.radians(load_sensor("vlp16").laser_elevation_deg))[np.arange(count) % 16]
    rows = zip(4 * np.sin(azimuth), 4 * np.cos(azimuth), z, ids, times, strict=True)
    lines = [",".join(map(repr, map(float, row))) for row in rows]
    path.write_text("\n".join(["x,y,z,laser,t", *lines]) + "\n")
    return path


SINCE_S = 0.1 * np.arange(90) / 90


@pytest.mark.parametrize(
    ("times", "line"),
    [
        (SINCE_S, None),
        (SINCE_S - 0.1, None),
        (SINCE_S * 1e6, "times in column t: us"),
        (10 * SINCE_S, "column t has shares of a turn (0 to 0.988889), which are no times"),
        (0 * SINCE_S, "column t has one time for all points (0)"),
        (SINCE_S[::-1], "column t has times that fall from point to point"),
        (SINCE_S + 3600 * (SINCE_S > 0.05), "column t leaps by 3600 s after 0.05 s"),
    ],
    ids=["s", "negative", "us", "shares", "constant", "falling", "leap"],
)
def test_times_of_clouds_are_seconds_or_a_word_is_said(
    times: Any, line: str | None, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = ring_of_turns(tmp_path / "a.csv", times)
    seconds = read_recording(path)["timestamp"]
    is_left_out = line and ("shares" in line or "one time" in line)
    units = {"us": 1e6}.get(line.rpartition(" ")[2], 1) if line else 1
    assert seconds == pytest.approx(0 * times if is_left_out else times / units, abs=1e-9)
    ending = ": its times are left out" * bool(is_left_out)
    assert caplog.messages == ([f"{path}: {line}{ending}"] if line else [])


def test_single_precision_since_1970_is_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rows = np.zeros(90, [*((each, "<f4") for each in ("x", "y", "z", "time")), ("ring", "<u2")])
    azimuth = np.radians(4 * np.arange(90))
    rows["x"], rows["y"], rows["z"] = (
        4 * np.sin(azimuth),
        4 * np.cos(azimuth),
        4 * np.tan(np.radians(1)),
    )
    rows["ring"], rows["time"] = 8, 1.7e9 + SINCE_S
    header = HEADER.replace("x y z _ ring", "x y z time ring").replace("4 4 4 1 2", "4 4 4 4 2")
    header = header.replace("F F F U U", "F F F F U").replace("1 1 1 3 1", "1 1 1 1 1")
    header = header.replace("WIDTH 2", "WIDTH 90").replace("POINTS 2", "POINTS 90")
    path = tmp_path / "a.pcd"
    path.write_bytes(header.encode() + b"DATA binary\n" + rows.tobytes())
    assert set(read_recording(path)["timestamp"]) == {0}
    fault = "column time has times of float32 in steps of 128 s: its times are left out"
    assert caplog.messages == [f"{path}: {fault}"]


def test_lasers_counted_from_one_are_refused(tmp_path: Path) -> None:
    """Also where neighbours are so near that every point is within half a degree of its cone."""
    lasers = np.arange(90) % 16 + 1
    path = ring_of_turns(tmp_path / "a.csv", SINCE_S.tolist(), lasers)
    with pytest.raises(
        InputError, match=r"column laser has a value that .* VLP-16: 16, not 0 to 15"
    ):
        read_recording(path)
    sensor = load_sensor("alpha_prime")
    order = np.argsort(sensor.laser_elevation_deg)
    ranks = np.repeat(np.arange(10, 110), 4)
    azimuth = np.radians(np.tile([10, 100, 190, 280], 100))
    z = 4 * np.tan(np.radians(np.asarray(sensor.laser_elevation_deg)[order[ranks]]))
    z += np.asarray(sensor.vertical_correction_mm or np.zeros(128))[order[ranks]] / 1000
    for shift, fault in ((0, None), (1, r"column ring has no lasers: points lie .* from 0\?\)$")):
        rows = zip(4 * np.sin(azimuth), 4 * np.cos(azimuth), z, ranks + shift, strict=True)
        lines = [",".join(map(repr, map(float, row))) for row in rows]
        path.write_text("\n".join(["x,y,z,ring", *lines]) + "\n")
        if fault is None:
            assert read_recording(path, sensor)["laser_id"].tolist() == order[ranks].tolist()
            continue
        with pytest.raises(InputError, match=fault):
            read_recording(path, sensor)

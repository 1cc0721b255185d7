"""Folders of frames: a file for each turn or message, with times and poses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import read_cloud
from cloud_files.pcd import read_pcd
from cloud_files.poses import kitti_bytes, read_poses, read_times, tum_bytes
from pointkit.errors import InputError
from pointkit.lidar.return_table import read_return_table
from pointkit.lidar.sensors import load_sensor
from puck.recordings.packet_turns import returns_of_packets
from puckbench.cli import main
from puckbench.planning.user_files import UserRun
from puckbench.recordings import message_returns
from puckbench.recordings.table_turns import rings_of_table
from puckbench.scene_sets.registry import open_scene_set
from tests.puckbench.cli.test_round_trips import _done
from tests.support.cloud_turns import STAMP_S, TURN_S, bag, turns
from tests.support.ouster import capture, images, metadata, packets
from tests.support.sensor_scenes import ROOM, room
from tests.support.spinning import PACKET, pcap, rows, spin
from virtual_lidar import open_error_model, open_sweep, scan, write_scan

BEGUN_S = 1.6e9
"""When the capture's first packet was received, as `pcap` has it."""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("drive.pcap").write_bytes(pcap(rows(spin(packets=400))))
    return tmp_path


@pytest.mark.parametrize("form", ["pcd", "bin", "las", "laz", "ply", "csv"])
def test_the_whole_turns_of_a_recording_are_frames(form: str) -> None:
    returns = returns_of_packets(spin(packets=400))
    whole = range(1, len(returns.turns) - 1)
    row = _done("export", "drive.pcap", "frames/", "--format", form)
    assert (row["frames"], row["first_turn"]) == (len(whole), 1)
    files = sorted(Path("frames").iterdir())
    names = [f"{number:06d}.{form}" for number in range(len(whole))]
    assert [path.name for path in files] == [*names, "times.txt"]
    for number, path in zip(whole, files, strict=False):
        alone = Path(f"alone.{form}")
        _done("export", "drive.pcap", alone, "--turns", number)
        xyz = read_cloud(path, bin_columns="4" if form == "bin" else None).xyz
        expected = read_cloud(alone, bin_columns="4" if form == "bin" else None).xyz
        assert np.array_equal(xyz, expected)
    clock_us = np.array([turn.times[0] for turn in returns.turns if turn.times is not None])
    since_us = np.mod(clock_us.astype(np.int64) - int(clock_us[0]), 3_600_000_000)
    assert np.array_equal(read_times(Path("frames/times.txt")), since_us[1:-1] / 1e6)


def test_points_have_intensity_ring_and_time_since_the_frame() -> None:
    _done("export", "drive.pcap", "frames", "--format", "pcd", "--turns", "2-3")
    assert len(list(Path("frames").glob("*.pcd"))) == 2
    frame = read_pcd(Path("frames/000000.pcd"))
    assert [*frame] == ["x", "y", "z", "intensity", "ring", "time"]
    times = read_times(Path("frames/times.txt"))
    assert 0 <= frame["time"].min() < 0.002
    assert frame["time"].max() <= np.diff(times)[0] + 1e-6


def test_a_table_of_capture_gives_the_same_frames() -> None:
    _done("capture", "drive.pcap", "returns.parquet")
    _done("export", "drive.pcap", "a", "--format", "pcd")
    _done("export", "returns.parquet", "b", "--format", "pcd")
    table = read_return_table(Path("returns.parquet"))
    assert len(list(Path("b").iterdir())) == len(np.unique(table["turn"])) - 1  # and the times
    columns = read_pcd(Path("b/000000.pcd"))
    rows_of_turn = table["turn"] == 1
    assert np.array_equal(columns["intensity"], table["reflectivity"][rows_of_turn])
    order = np.argsort(np.argsort(load_sensor("vlp16").laser_elevation_deg))
    assert np.array_equal(columns["ring"], order[table["laser_id"][rows_of_turn]])
    times = table["timestamp"][rows_of_turn]
    assert columns["time"] == pytest.approx(times - times.min(), abs=1e-6)
    assert read_times(Path("b/times.txt"))[0] == pytest.approx(times.min(), abs=1e-6)


@pytest.mark.parametrize("absolute", [False, True])
def test_messages_are_frames_at_their_first_point(
    absolute: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(message_returns, "_BATCH", 3)  # batches follow one another
    time = (lambda since, begin: STAMP_S + begin + since) if absolute else None
    more = {"name": "timestamp", "kind": "<f8", "time": time} if time else {}
    clouds = turns(5, **more)
    clouds[3] = clouds[3][:0]
    bag(Path("drive.mcap"), clouds)
    row = _done("export", "drive.mcap", "frames", "--format", "pcd")
    assert row["frames"] == 4
    assert "frames: left out 1 frame without a point\n" in capsys.readouterr().err
    steps = np.array([0, 1, 2, 4]) * TURN_S
    assert read_times(Path("frames/times.txt")) == pytest.approx(STAMP_S + steps, abs=1e-5)
    last = read_pcd(Path("frames/000003.pcd"))
    for name in ("x", "y", "z", "ring", "intensity"):
        assert np.array_equal(last[name], clouds[4][name].astype(last[name].dtype))
    assert last["time"].min() == 0
    assert last["time"].max() == pytest.approx(TURN_S * 63 / 64, abs=1e-6)


def test_frames_of_a_recording_have_the_poses_of_a_file() -> None:
    """The sensor goes forward at 2 m/s; the file has a pose every 20 ms, or one for each frame."""
    _done("export", "drive.pcap", "plain", "--format", "bin")
    seconds = read_times(Path("plain/times.txt"))
    times = BEGUN_S - 0.1 + 0.02 * np.arange(50)
    moved = np.tile(np.eye(4), (len(times), 1, 1))
    moved[:, 1, 3] = 2 * (times - BEGUN_S)
    Path("way.tum").write_bytes(tum_bytes(times, moved))
    _done("export", "drive.pcap", "frames", "--format", "bin", "--poses", "way.tum")
    _, poses = read_poses(Path("frames/poses.txt"))
    assert poses[:, 1, 3] == pytest.approx(2 * seconds, abs=2e-4)  # jitter of the reception
    assert np.array_equal(poses[:, :3, :3], np.tile(np.eye(3), (len(seconds), 1, 1)))
    again, _ = read_poses(Path("frames/poses.tum"))
    assert again == pytest.approx(seconds, abs=1e-6)
    Path("one.txt").write_bytes(kitti_bytes(moved[: len(seconds)]))
    _done("export", "drive.pcap", "others", "--format", "bin", "--poses", "one.txt")
    assert np.allclose(read_poses(Path("others/poses.txt"))[1], moved[: len(seconds)])


def test_messages_and_tables_have_the_poses_of_a_file() -> None:
    bag(Path("drive.mcap"), turns(5))
    times = STAMP_S + TURN_S * np.arange(-1, 7)
    moved = np.tile(np.eye(4), (len(times), 1, 1))
    moved[:, 0, 3] = np.arange(-1, 7)
    Path("way.tum").write_bytes(tum_bytes(times, moved))
    _done("export", "drive.mcap", "a", "--format", "pcd", "--poses", "way.tum")
    assert read_poses(Path("a/poses.txt"))[1][:, 0, 3] == pytest.approx(np.arange(5), abs=1e-5)
    _done("capture", "drive.mcap", "returns.parquet", "--sensor", "vlp16")
    Path("way.tum").write_bytes(tum_bytes(times - STAMP_S, moved))  # as the times of the table
    _done("export", "returns.parquet", "b", "--format", "pcd", "--poses", "way.tum")
    assert read_poses(Path("b/poses.txt"))[1][:, 0, 3] == pytest.approx(np.arange(5), abs=1e-5)


def test_times_and_poses_of_a_folder_are_no_clouds() -> None:
    bag(Path("drive.mcap"), turns(3))
    Path("way.txt").write_bytes(kitti_bytes(np.tile(np.eye(4), (3, 1, 1))))
    _done("export", "drive.mcap", "frames", "--format", "pcd", "--poses", "way.txt")
    assert {path.suffix for path in Path("frames").iterdir()} == {".pcd", ".txt", ".tum"}
    config = UserRun(("frames",), ("draco",), "out").configuration()
    assert "unused" not in config or not any("txt" in name for name in config["unused"])
    scenes = open_scene_set("point_clouds", {"path": "frames"})
    assert scenes.names() == ["000000", "000001", "000002"]
    seconds = [scenes.load(name).time_s for name in scenes.names()]
    assert seconds == pytest.approx(STAMP_S + TURN_S * np.arange(3), abs=1e-5)
    assert [path.name for path in scenes.files("000001")] == ["000001.pcd", "times.txt"]
    Path("frames/times.txt").write_text("0\n1\n")
    again = open_scene_set("point_clouds", {"path": "frames"})
    with pytest.raises(InputError, match=r"000002.pcd: times.txt has 2 times, none for this"):
        again.load("000002")


def test_frames_of_a_virtual_scan_are_in_the_sensors_frame_with_its_poses() -> None:
    way = ((0, 0, 0, 0, 0, 0, 0), (0.3, 0.2, 0.1, 0, 0, 0, 0.3))
    sweep = {"duration_s": 0.3, "frames_per_second": 10, "trajectory": way}
    sensor, random = load_sensor("vlp16"), np.random.default_rng(0)
    model = open_error_model("vlp16")
    options = open_sweep({**sweep, "azimuth_step_deg": 2.0, "rotation_hz": 10})
    table = scan(room(), sensor, options, model, ROOM / 2, random)
    write_scan(Path("scan.parquet"), table)
    _done("export", "scan.parquet", "frames", "--format", "ply", "--clean")
    _, poses = read_poses(Path("frames/poses.txt"))
    assert len(poses) == 3
    assert read_times(Path("frames/times.txt")) == pytest.approx([0, 0.1, 0.2])
    assert np.allclose(poses[0][:3, 3], ROOM / 2)
    for number, pose in enumerate(poses):
        cloud = read_cloud(f"frames/{number:06d}.ply")
        begin = cloud.fields["time"] == cloud.fields["time"].min()
        world = cloud.xyz[begin] @ pose[:3, :3].T + pose[:3, 3]
        true = np.column_stack([table[axis][table["frame"] == number] for axis in "xyz"])
        assert world == pytest.approx(true[begin], abs=1e-6)
    assert np.linalg.norm(poses[2][:3, 3] - poses[0][:3, 3]) == pytest.approx(0.2236 * 2 / 3, 1e-3)


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["drive.pcap", "full", "--format", "pcd"], "full: exists already, and is not an empty"),
        (["drive.pcap", "drive.pcap", "--format", "pcd"], "drive.pcap: exists already"),
        (["drive.pcap", "new", "--format", "pcd", "--turns", "99"], "drive.pcap: has turns 0 to"),
        (["drive.pcap", "new", "--format", "pcd", "--clean"], "--clean: is for scans"),
        (["other.ply", "new", "--format", "pcd"], "other.ply: no recording or table of turns"),
        (["drive.pcap", "new"], "new: give it a suffix, or name the format"),
        (["none.pcap", "new", "--format", "pcd"], "none.pcap: no such file"),
        (["drive.pcap", "new.pcd", "--poses", "a.tum"], "--poses: only with --format"),
        (["drive.pcap", "new", "--format", "pcd", "--poses", "none.tum"], "none.tum: no such"),
        (["drive.pcap", "new", "--format", "pcd", "--poses", "far.tum"], "far.tum: 3 poses for"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(
    words: list[str], fault: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("full").mkdir()
    Path("full/a.txt").touch()
    Path("far.tum").write_bytes(tum_bytes(np.arange(3.0), np.tile(np.eye(4), (3, 1, 1))))
    before = {path: path.stat().st_size for path in Path().rglob("*")}
    assert main(["export", *words]) == 2
    error = capsys.readouterr().err
    assert fault in error
    assert error.count("\n") == 1
    assert {path: path.stat().st_size for path in Path().rglob("*")} == before


def test_an_empty_folder_is_filled_and_a_failure_leaves_it_empty(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(message_returns, "_BATCH", 2)  # two frames are written before the fault
    Path("frames").mkdir()
    bag(Path("odd.mcap"), turns(5)[:4], frames=["sensor", "sensor", "other", "sensor"])
    assert main(["export", "odd.mcap", "frames", "--format", "las"]) == 2
    assert not list(Path().glob(".*"))
    assert not list(Path("frames").iterdir())
    _done("export", "drive.pcap", "frames", "--format", "las")
    assert list(Path("frames").iterdir())


def test_rings_count_lasers_without_returns() -> None:
    """In a recording, its table, and a scan, lasers 4 and 9 see nothing."""
    table = spin(packets=400).copy().view(PACKET)[:, 0]
    for laser in (4, 9, 20, 25):  # of two firings of 16 lasers
        table["blocks"]["returns"]["distance"][..., laser] = 0
    seen = table.view(np.uint8).reshape(400, -1)
    Path("drive.pcap").write_bytes(pcap(rows(seen)))
    _done("capture", "drive.pcap", "returns.parquet")
    _done("export", "drive.pcap", "a", "--format", "pcd")
    _done("export", "returns.parquet", "b", "--format", "pcd")
    order = np.argsort(np.argsort(load_sensor("vlp16").laser_elevation_deg))
    for name in ("000000.pcd", "000001.pcd"):
        first, second = (read_pcd(Path(folder) / name) for folder in "ab")
        assert set(first["ring"]) == {*range(16)} - {*order[[4, 9]]}
        for column in ("x", "ring"):
            assert np.array_equal(first[column], second[column])


def test_rings_of_messages_are_those_of_their_table() -> None:
    """The messages have no point of rings 3 and 15."""
    clouds = [each[~np.isin(each["ring"], (3, 15))] for each in turns(3)]
    bag(Path("drive.mcap"), clouds)
    for words in ([], ["--sensor", "vlp16"]):
        _done("capture", "drive.mcap", "returns.parquet", *words)
        folder = f"frames{len(words)}"
        _done("export", "returns.parquet", folder, "--format", "pcd")
        frame = read_pcd(Path(folder) / "000001.pcd")
        assert np.array_equal(frame["ring"], clouds[1]["ring"])


def test_rings_of_earlier_tables_and_of_odd_descriptions() -> None:
    _done("capture", "drive.pcap", "returns.parquet")
    table = read_return_table(Path("returns.parquet"))
    order = np.argsort(np.argsort(load_sensor("vlp16").laser_elevation_deg))
    for rings in (None, [], [1] * 15, ["a"] * 16, [-1] * 16, [1 << 16] * 16, 7):
        about = {**table.about, "rings": rings}
        assert np.array_equal(rings_of_table(replace(table, about=about)), order[table["laser_id"]])


@pytest.mark.parametrize(
    ("length", "count", "told"), [(15, 1, "its turn"), (30, 2, "turns 0 to 1")]
)
def test_tables_without_a_whole_turn_are_told(
    length: int, count: int, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("short.pcap").write_bytes(pcap(rows(spin(packets=length))))
    _done("capture", "short.pcap", "short.parquet")
    capsys.readouterr()
    row = _done("export", "short.parquet", "short", "--format", "pcd")
    assert row["frames"] == count
    fault = "may be cut off where the recording begins or ends; they are used, as no other is there"
    assert f"short.parquet: {told} {fault}\n" in capsys.readouterr().err
    assert main(["export", "short.pcap", "none", "--format", "pcd"]) == 2


def test_whole_turns_of_an_ousters_table_are_those_of_its_recording(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The first turn is cut off, the last is whole."""
    profile = "RNG15_RFL8_NIR8"
    sent = [packet for frame in range(3) for packet in packets(profile, *images(profile), frame)]
    Path("os.json").write_text(json.dumps(metadata(profile)))
    for first, whole in ((5, 2), (0, 3)):
        Path("os.pcap").write_bytes(capture(sent[first:]))
        _done("capture", "os.pcap", "os.parquet")
        for source in ("os.pcap", "os.parquet"):
            row = _done("export", source, f"{source}{first}", "--format", "pcd")
            assert row["frames"] == whole
        frames = [Path(f"{source}{first}") / "000001.pcd" for source in ("os.pcap", "os.parquet")]
        assert np.array_equal(*(read_pcd(frame)["x"] for frame in frames))
    assert "cut off" not in capsys.readouterr().err

"""Exported scans and captures, read back by other readers or by the formats' own layouts."""

from __future__ import annotations

import csv
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import read_cloud
from pointkit.column_tables import write_column_table
from pointkit.errors import InputError
from pointkit.lidar.sensors import load_sensor
from puck.recordings.packet_turns import returns_of_packets
from puckbench.cli import main
from puckbench.recordings.export import FORMATS, export, read_source
from puckbench.recordings.reading import read_packets, read_recording
from tests.support.sensor_scenes import ROOM, room
from tests.support.spinning import DUAL, HDL32E, PUCK_HIRES, STRONGEST, VLP16, pcap, rows, spin
from virtual_lidar import ScanTable, open_error_model, open_sweep, scan, write_scan

DATA = Path(__file__).parents[2] / "data" / "capture"
SWEEP = {"duration_s": 0.05, "azimuth_step_deg": 1.0}


@pytest.fixture(scope="module")
def table() -> ScanTable:
    sensor, model = load_sensor("vlp16"), open_error_model("vlp16")
    return scan(room(), sensor, open_sweep(SWEEP), model, ROOM / 2, np.random.default_rng(0))


@pytest.fixture
def scan_file(table: ScanTable, tmp_path: Path) -> Path:
    write_scan(tmp_path / "scan.parquet", table)
    return tmp_path / "scan.parquet"


@pytest.fixture
def capture_file(tmp_path: Path) -> Path:
    assert main(["capture", str(DATA / "dual.pcap"), str(tmp_path / "capture.parquet")]) == 0
    return tmp_path / "capture.parquet"


def test_ply_has_the_measured_points_and_every_attribute(table: ScanTable, tmp_path: Path) -> None:
    from plyfile import PlyData

    export(tmp_path / "a.ply", table)
    vertices = PlyData.read(tmp_path / "a.ply")["vertex"]
    points = np.column_stack([vertices[axis] for axis in "xyz"])
    assert np.array_equal(points, table.xyz_noisy)
    assert np.array_equal(vertices["laser_id"], table["laser_id"])
    assert np.array_equal(vertices["distance"], table["distance_noisy"])
    assert np.array_equal(vertices["nz"], table["nz"])


def test_ply_is_a_cloud_for_the_codecs(table: ScanTable, tmp_path: Path) -> None:
    from cloud_files.clouds import read_cloud

    export(tmp_path / "a.ply", table, clean=True)
    assert np.array_equal(read_cloud(tmp_path / "a.ply").xyz, table.xyz)


@pytest.mark.parametrize("clean", [False, True])
def test_packets_have_measured_distances_or_true_ones(
    table: ScanTable, tmp_path: Path, clean: bool
) -> None:
    export(tmp_path / "a.pcap", table, clean=clean)
    read = np.sort(read_recording(tmp_path / "a.pcap")["distance"])
    expected = np.sort(table["distance" if clean else "distance_noisy"])
    assert np.abs(read - expected).max() <= 1.0e-3 + 1e-12


def test_pcd_is_read_by_open3d_with_the_lasers_as_labels(table: ScanTable, tmp_path: Path) -> None:
    import open3d

    export(tmp_path / "a.pcd", table)
    cloud = open3d.t.io.read_point_cloud(str(tmp_path / "a.pcd"))
    assert cloud.point.positions.numpy() == pytest.approx(table.xyz_noisy, abs=1e-6)
    assert cloud.point.label.numpy()[:, 0].tolist() == table["laser_id"].tolist()
    assert np.array_equal(cloud.point.timestamp.numpy()[:, 0], table["timestamp"])


def test_csv_numbers_come_back_the_same(table: ScanTable, tmp_path: Path) -> None:
    export(tmp_path / "a.csv", table)
    with (tmp_path / "a.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["z"]) for row in rows] == table["z_noisy"].tolist()
    assert [int(row["laser_id"]) for row in rows] == table["laser_id"].tolist()


def test_las_by_the_layout_of_its_specification(table: ScanTable, tmp_path: Path) -> None:
    export(tmp_path / "a.las", table)
    data = (tmp_path / "a.las").read_bytes()
    assert data[:4] == b"LASF"
    assert data[24:26] == b"\x01\x02"
    start, _, kind, length, points = struct.unpack_from("<IIBHI", data, 96)
    assert (kind, length, points) == (1, 28, len(table))
    assert len(data) == start + length * points
    scale, offset = struct.unpack_from("<3d", data, 131), struct.unpack_from("<3d", data, 155)
    rows = [struct.unpack_from("<iiiHBBbBHd", data, start + k * length) for k in range(points)]
    xyz = np.array([row[:3] for row in rows]) * scale + offset
    assert np.abs(xyz - table.xyz_noisy).max() <= 0.5e-4 + 1e-9
    assert [row[7] for row in rows] == table["laser_id"].tolist()
    assert [row[9] for row in rows] == table["timestamp"].tolist()
    bounds = struct.unpack_from("<6d", data, 179)
    assert bounds == pytest.approx(np.column_stack([xyz.max(0), xyz.min(0)]).ravel(), abs=1e-9)


def test_las_and_laz_are_read_by_laspy(table: ScanTable, tmp_path: Path) -> None:
    import laspy

    for suffix in ("las", "laz"):
        export(tmp_path / f"a.{suffix}", table)
        read = laspy.read(tmp_path / f"a.{suffix}")
        assert np.abs(np.asarray(read.xyz) - table.xyz_noisy).max() <= 0.5e-4 + 1e-9
        assert np.array_equal(read.user_data, table["laser_id"])
        assert np.array_equal(read.point_source_id, table["frame"])
        assert np.array_equal(read.gps_time, table["timestamp"])
    assert (tmp_path / "a.laz").stat().st_size < 0.7 * (tmp_path / "a.las").stat().st_size


def test_evd_is_read_as_blensor_reads_it(table: ScanTable, tmp_path: Path) -> None:
    export(tmp_path / "a.evd", table)
    data = (tmp_path / "a.evd").read_bytes()
    count = struct.unpack_from("i", data)[0]
    rays = [struct.unpack_from("14dQ", data, 4 + 120 * k) for k in range(count)]
    assert struct.unpack("i", data[4 + 120 * count :])[0] == -1
    names = ("timestamp", "yaw", "pitch", "distance", "distance_noisy")
    expected = [table[name] for name in names]
    assert np.array_equal(np.array(rays)[:, :5], np.column_stack(expected))
    assert np.array_equal(np.array(rays)[:, 5:11], np.hstack([table.xyz, table.xyz_noisy]))
    assert [ray[14] for ray in rays] == table["object_id"].tolist()


def test_a_scan_exported_as_packets_is_read_as_a_capture(scan_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.pcap"
    assert main(["export", str(scan_file), str(out)]) == 0
    assert len(read_recording(out)) == len(read_source(scan_file))


def test_a_real_capture_is_exported_with_its_lasers(capture_file: Path, tmp_path: Path) -> None:
    from plyfile import PlyData

    assert main(["export", str(capture_file), str(tmp_path / "a.ply")]) == 0
    expected = read_recording(DATA / "dual.pcap")
    vertices = PlyData.read(tmp_path / "a.ply")["vertex"]
    assert np.array_equal(vertices["y"], expected["y"])
    assert np.array_equal(vertices["return_kind"], expected["return_kind"])


def test_reflectivity_of_a_capture_is_the_intensity_of_las(tmp_path: Path) -> None:
    table = read_recording(DATA / "single.pcap")
    export(tmp_path / "a.las", table)
    data = (tmp_path / "a.las").read_bytes()
    assert struct.unpack_from("<H", data, 227 + 12)[0] == table["reflectivity"][0]


@pytest.mark.parametrize(
    ("out", "extra", "message"),
    [
        ("a.evd", [], "a recording has no true coordinates"),
        ("a.ply", ["--clean"], "a recording has no true coordinates"),
        ("a.xyz", [], "unknown suffix '.xyz' (known: .ply, .pcd, .csv"),
    ],
)
def test_what_cannot_be_exported_is_one_line_and_no_file(
    capture_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    out: str,
    extra: list[str],
    message: str,
) -> None:
    capsys.readouterr()
    assert main(["export", str(capture_file), str(tmp_path / out), *extra]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert message in lines[0]
    assert [path.name for path in tmp_path.iterdir()] == ["capture.parquet"]


@pytest.mark.parametrize("suffix", FORMATS)
def test_it_is_told_how_many_points_were_written(
    table: ScanTable, tmp_path: Path, suffix: str
) -> None:
    assert export(tmp_path / f"a{suffix}", table)["points"] == len(table)


@pytest.mark.parametrize("suffix", FORMATS)
def test_no_return_is_an_error(table: ScanTable, tmp_path: Path, suffix: str) -> None:
    with pytest.raises(InputError, match="no return to export"):
        export(tmp_path / f"a{suffix}", table.select(np.zeros(len(table), dtype=bool)))


def test_other_files_are_no_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.parquet").write_bytes(b"something else")
    assert main(["export", str(tmp_path / "a.parquet"), str(tmp_path / "a.ply")]) == 2
    assert "a.parquet: not a scan table (Parquet)" in capsys.readouterr().err
    assert main(["export", str(tmp_path / "b.parquet"), str(tmp_path / "a.ply")]) == 2
    assert "b.parquet: no such file" in capsys.readouterr().err


def test_a_capture_of_another_sensor_is_one_line_and_no_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = bytearray((DATA / "single.pcap").read_bytes())
    for end in range(24 + 16 + 42 + 1206, len(data) + 1, 16 + 42 + 1206):
        data[end - 1] = 0x31
    (tmp_path / "a.pcap").write_bytes(data)
    assert main(["capture", str(tmp_path / "a.pcap"), str(tmp_path / "a.parquet")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "a.pcap: packets of Velarray" in error
    assert not (tmp_path / "a.parquet").exists()


def test_a_puck_hires_has_its_own_elevations() -> None:
    from puck.recordings.packet_turns import decode_packets
    from puckbench.recordings.reading import read_packets

    payloads = read_packets(DATA / "single.pcap").payloads.copy()
    payloads[:, 1205] = 0x24
    table = decode_packets(payloads)
    assert np.degrees(table["elevation"].max()) == pytest.approx(10)


def test_points_too_far_apart_for_las_are_refused(table: ScanTable, tmp_path: Path) -> None:
    far = table["x_noisy"].copy()
    far[0] = 1e6
    with pytest.raises(InputError, match="too far apart"):
        export(tmp_path / "a.las", replace(table, columns={**table.columns, "x_noisy": far}))


def test_a_written_capture_table_is_told_from_a_scan(tmp_path: Path) -> None:
    table = read_recording(DATA / "single.pcap")
    write_column_table(tmp_path / "a.parquet", table)
    assert type(read_source(tmp_path / "a.parquet")) is type(table)


@pytest.fixture(params=[(VLP16, STRONGEST), (VLP16, DUAL), (PUCK_HIRES, STRONGEST)])
def recording(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / "drive.pcap"
    path.write_bytes(pcap(rows(spin(*request.param, packets=600, rise=40))))
    return path


def _columns(path: Path) -> dict[str, np.ndarray]:
    cloud = read_cloud(path)
    names = {"gps_time": "time", "user_data": "ring"}  # of LAS
    fields = {names.get(name, name): np.asarray(part, float) for name, part in cloud.fields.items()}
    return {**dict(zip("xyz", cloud.xyz.T, strict=True)), **fields}


def _sorted(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    order = np.lexsort((np.hypot(columns["x"], columns["y"]), columns["time"], columns["ring"]))
    return {name: part[order] for name, part in columns.items()}


@pytest.mark.parametrize("suffix", [".pcd", ".ply", ".csv", ".las", ".laz"])
def test_turns_of_a_recording_have_the_returns_of_a_capture(recording: Path, suffix: str) -> None:
    """`capture` converts packets by itself, with the times of Velodyne's manual."""
    out = recording.with_suffix(suffix)
    assert main(["export", str(recording), str(out), "--turns", "1-2"]) == 0
    columns = _columns(out)
    packets = [turn.times for turn in returns_of_packets(read_packets(recording).payloads).turns]
    first, end = (
        np.mod(1e-6 * (float(packets[k][0]) - float(packets[0][0])), 3600) for k in (1, 3)
    )  # the clock restarts every hour
    table = read_recording(recording)
    table = table.select((table["timestamp"] > first - 1e-7) & (table["timestamp"] < end - 1e-7))
    rings = np.unique(table["elevation"], return_inverse=True)[1]
    expected = {axis: table[axis] for axis in "xyz"}
    expected |= {"ring": rings, "intensity": table["reflectivity"]}
    expected |= {"time": table["timestamp"] - first}
    assert len(columns["x"]) == len(expected["x"])
    columns, expected = (_sorted(each) for each in (columns, expected))
    # Packets of `spin` last as long in dual mode as in single mode, unlike those of a sensor.
    late = 2e-6 if table.about["returns"] == "strongest" else 1.327e-3 / 2
    for name, most in {"ring": 0, "intensity": 0, "time": late, "x": 5e-3, "y": 5e-3}.items():
        assert np.abs(columns[name] - expected[name]).max() <= most, name
    assert np.abs(columns["z"] - expected["z"]).max() <= 1e-4


def test_turns_of_a_recording_are_frames_of_kitti_and_pcl(recording: Path, tmp_path: Path) -> None:
    out = {suffix: tmp_path / f"turn{suffix}" for suffix in (".bin", ".pcd")}
    for path in out.values():
        assert main(["export", str(recording), str(path)]) == 0  # the first whole turn
    header, _, data = out[".pcd"].read_bytes().partition(b"DATA binary\n")
    assert b"FIELDS x y z intensity ring time\nSIZE 4 4 4 4 2 4\nTYPE F F F F U F\n" in header
    kinds = [(name, "<f4") for name in ("x", "y", "z", "intensity", "time")]
    points = np.frombuffer(data, [*kinds[:4], ("ring", "<u2"), kinds[4]])
    frame = np.frombuffer(out[".bin"].read_bytes(), "<f4").reshape(-1, 4)
    assert len(points) > 5000
    assert np.array_equal(frame[:, :3], np.column_stack([points[axis] for axis in "xyz"]))
    assert np.allclose(255 * frame[:, 3], points["intensity"])
    assert points["intensity"].max() > 20
    heights = [
        np.median((points["z"] / np.hypot(points["x"], points["y"]))[points["ring"] == k])
        for k in range(16)
    ]
    assert np.all(np.diff(heights) > 0)
    assert 0.09 < np.ptp(points["time"]) < 0.21


def test_an_hdl_32e_and_a_compressed_recording_are_exported(tmp_path: Path) -> None:
    drive, out = tmp_path / "drive.pcap", tmp_path / "a.ply"
    drive.write_bytes(pcap(rows(spin(HDL32E, packets=300, rise=40))))
    assert main(["export", str(drive), str(out), "--turns", "1"]) == 0
    assert main(["compress", str(drive), str(tmp_path / "drive.puck")]) == 0
    assert main(["export", str(tmp_path / "drive.puck"), str(tmp_path / "b.ply")]) == 0
    assert out.read_bytes() == (tmp_path / "b.ply").read_bytes()
    cloud = read_cloud(out)
    assert set(np.unique(cloud.fields["ring"])) == set(range(32))
    fired = np.lexsort((cloud.fields["ring"], cloud.fields["time"]))
    assert (np.diff(cloud.fields["time"][fired]) >= 0).all()


def test_turns_of_a_table_of_firings_are_exported(recording: Path, tmp_path: Path) -> None:
    assert main(["prepare", str(recording), str(tmp_path / "a.ply"), "--turns", "1-2"]) == 0
    for source, turn, out in ((recording, "2", "b.csv"), (tmp_path / "a.parquet", "1", "c.csv")):
        assert main(["export", str(source), str(tmp_path / out), "--turns", turn]) == 0
    assert (tmp_path / "b.csv").read_bytes() == (tmp_path / "c.csv").read_bytes()


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["drive.pcap", "a.pcd", "--turns", "70"], "drive.pcap: has turns 0 to"),
        (["drive.pcap", "a.pcd", "--turns", "3-1"], "--turns: the last turn is before the first"),
        (["drive.pcap", "a.pcd", "--turns", "x"], "--turns: must be a number"),
        (["drive.pcap", "a.evd"], "a.evd: a recording has no true coordinates"),
        (["drive.pcap", "a.pcd", "--clean"], "a.pcd: a recording has no true coordinates"),
        (["drive.pcap", "a.pcd", "--stream", "1.2.3.4:5"], "1.2.3.4:5"),
        (["none.pcap", "a.pcd"], "none.pcap: no such file"),
        (["scan.parquet", "a.pcd", "--turns", "0"], "scan.parquet: --turns is for recordings"),
    ],
)
def test_turns_that_cannot_be_exported_are_one_line(
    recording: Path,
    scan_file: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    fault: str,
) -> None:
    monkeypatch.chdir(recording.parent)
    assert main(["export", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert fault in line
    assert not Path(words[1]).exists()

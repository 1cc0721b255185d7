"""Exported scans and captures, read back by other readers or by the formats' own layouts."""

from __future__ import annotations

import csv
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from puckbench.cli import main
from puckbench.core.errors import InputError
from puckbench.lidar import ScanTable, load_sensor, open_error_model, open_sweep, scan, write_scan
from puckbench.lidar.export import FORMATS, export, read_source
from puckbench.lidar.recordings import read_recording, write_returns
from tests.support.sensor_scenes import ROOM, room

DATA = Path(__file__).parents[1] / "data" / "capture"
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
    from puckbench.io.clouds import read_cloud

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
        data[end - 1] = 0x63
    (tmp_path / "a.pcap").write_bytes(data)
    assert main(["capture", str(tmp_path / "a.pcap"), str(tmp_path / "a.parquet")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "a.pcap: packets of HDL-64E" in error
    assert not (tmp_path / "a.parquet").exists()


def test_a_puck_hires_has_its_own_elevations() -> None:
    from puckbench.lidar.recordings import decode_packets
    from puckbench.lidar.recordings.reading import read_packets

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
    write_returns(tmp_path / "a.parquet", table)
    assert type(read_source(tmp_path / "a.parquet")) is type(table)

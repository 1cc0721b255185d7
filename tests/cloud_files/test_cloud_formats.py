"""Clouds in all formats, each written by an independent library."""

from __future__ import annotations

import io
import platform
import re
import struct
import sys
from pathlib import Path

import laspy
import numpy as np
import pytest

import cloud_files
from cloud_files import content
from cloud_files.clouds import SUFFIXES, read_cloud, write_cloud
from cloud_files.e57 import parse_e57
from cloud_files.meshes import SUFFIXES as MESHES
from cloud_files.point_columns import cloud_from_columns
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud

RNG = np.random.default_rng(5)
POINTS = RNG.random((40, 3)) * [50, 30, 10]
UTM = np.rint(POINTS * 1000) / 1000 + [500_000.0, 5_400_000.0, 250.0]
COLOURS = RNG.integers(0, 256, (40, 3)).astype(np.uint8)
INTENSITY = RNG.integers(0, 60_000, 40).astype(np.uint16)


def write_las(path: Path, scale: int = 256) -> None:
    header = laspy.LasHeader(point_format=3, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 5_400_000, 0]
    header.add_extra_dim(laspy.ExtraBytesParams("amplitude", np.float32))
    las = laspy.LasData(header)
    las.x, las.y, las.z = UTM.T
    las.intensity, las.gps_time = INTENSITY, np.arange(40) + 0.25
    las.classification, las.amplitude = np.full(40, 6), POINTS[:, 0]
    las.red, las.green, las.blue = COLOURS.T.astype(np.uint16) * scale
    las.write(path)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_a_surveyed_cloud_keeps_millimetres_colours_and_fields(tmp_path: Path, suffix: str) -> None:
    write_las(tmp_path / f"a{suffix}")
    cloud = read_cloud(tmp_path / f"a{suffix}")
    assert np.abs(cloud.xyz - UTM).max() < 2e-9
    assert np.array_equal(cloud.colours, COLOURS)
    assert set(cloud.fields) == {
        *("intensity", "classification", "gps_time", "amplitude"),
        *(set(cloud.fields) & {"return_number", "number_of_returns"}),
    }
    assert np.array_equal(cloud.fields["intensity"], INTENSITY)
    assert np.array_equal(cloud.fields["amplitude"], POINTS[:, 0].astype(np.float32))


def test_colours_of_16_bits_stand_beside_those_of_8(tmp_path: Path) -> None:
    write_las(tmp_path / "a.las", scale=255)
    cloud = read_cloud(tmp_path / "a.las")
    assert np.array_equal(cloud.fields["red_16"], COLOURS[:, 0] * np.uint16(255))
    assert np.array_equal(cloud.colours, (COLOURS.astype(int) * 255) >> 8)


def test_fields_come_back_from_the_clouds_own_file(tmp_path: Path) -> None:
    fields = {
        "intensity": INTENSITY,
        "gps time": np.arange(40) + 0.125,
        "stamp": np.arange(40, dtype=np.uint64) + np.uint64(2**60),
        "ring": np.arange(40, dtype=np.int64),
        "is_ground": np.arange(40) % 2 == 0,
        "label": np.full(40, 2**40),
    }
    write_cloud(tmp_path / "a.ply", PointCloud(UTM, colours=COLOURS, fields=fields))
    back = read_cloud(tmp_path / "a.ply")
    assert np.array_equal(back.xyz, UTM)
    assert np.array_equal(back.fields["gps_time"], fields["gps time"])
    halves = back.fields["stamp_high"].astype(np.uint64) << np.uint64(32)
    assert np.array_equal(halves | back.fields["stamp_low"], fields["stamp"])
    for name in ("intensity", "ring", "is_ground"):
        assert np.array_equal(back.fields[name], fields[name])
    assert np.array_equal(back.fields["label_"], fields["label"])
    assert list(back.select(np.array([3])).fields["ring"]) == [3]


def test_no_field_is_lost_by_its_name(tmp_path: Path) -> None:
    long = np.arange(40) + 2**60
    names = ("gps time", "gps_time", "Intensität", "Intensitat", "强度", "red", "red_", "id_low")
    fields = {name: np.full(40, place) for place, name in enumerate(names)} | {"id": long}
    write_cloud(tmp_path / "a.ply", PointCloud(UTM, fields=fields))
    back = read_cloud(tmp_path / "a.ply").fields
    written = ("gps_time", "gps_time_", "Intensitat", "Intensitat_", "_", "red_", "red__", "id_low")
    assert [back[name][0] for name in written] == list(range(8))
    halves = back["id__high"].astype(np.int64) << 32 | back["id__low"].astype(np.int64)
    assert np.array_equal(halves, long)


def test_a_text_with_a_german_header_is_read(tmp_path: Path) -> None:
    rows = "".join(f"{x:.3f},{y:.3f},{z:.3f},7\n" for x, y, z in POINTS)
    (tmp_path / "a.csv").write_bytes(f"x,y,z,Intensität\n{rows}".encode("latin-1"))
    assert (read_cloud(tmp_path / "a.csv").fields["Intensität"] == 7).all()


@pytest.mark.parametrize(
    ("colours", "expected", "has_fields"),
    [
        ([[-1, 0, 300 - 45]], [[0, 0, 255]], True),
        ([[100.5, 0, 1]], [[100, 0, 1]], True),
        ([[65535.0, 0, 257]], [[255, 0, 1]], False),
        ([[100.0, 0, 1]], [[100, 0, 1]], False),
    ],
)
def test_colours_that_do_not_fit_stand_beside_them(
    colours: list[list[float]], expected: list[list[int]], has_fields: bool
) -> None:
    columns = dict(zip("xyz", np.zeros((3, 1)), strict=True))
    columns |= dict(zip(("red", "green", "blue"), np.transpose(colours), strict=True))
    cloud = cloud_from_columns(columns)
    assert cloud.colours is not None
    assert cloud.colours.tolist() == expected
    if has_fields:
        wide = [cloud.fields[name] for name in ("red_16", "green_16", "blue_16")]
        assert np.array_equal(np.transpose(wide), colours)
    else:
        assert not cloud.fields


def test_coloured_pcd_of_open3d(tmp_path: Path) -> None:

    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(POINTS))
    cloud.colors = o3d.utility.Vector3dVector(COLOURS / 255)
    cloud.normals = o3d.utility.Vector3dVector(np.tile([0.0, 0, 1], (40, 1)))
    for name, ascii_ in (("a.pcd", False), ("b.pcd", True)):
        o3d.io.write_point_cloud(str(tmp_path / name), cloud, write_ascii=ascii_)
        back = read_cloud(tmp_path / name)
        assert np.abs(back.xyz - POINTS).max() < 1e-5
        assert np.array_equal(back.colours, COLOURS)
        assert back.normals is not None
    o3d.io.write_point_cloud(str(tmp_path / "c.ply"), cloud)
    assert np.array_equal(read_cloud(tmp_path / "c.ply").xyz, POINTS)
    assert np.array_equal(read_cloud(tmp_path / "c.ply").colours, COLOURS)
    o3d.io.write_point_cloud(str(tmp_path / "d.xyz"), cloud)
    assert np.abs(read_cloud(tmp_path / "d.xyz").xyz - POINTS).max() < 1e-9


def test_text_of_numpy_is_read_to_the_last_bit(tmp_path: Path) -> None:
    exact = UTM + RNG.random((40, 3))
    np.savetxt(tmp_path / "a.xyz", exact, fmt="%.17g")
    assert np.array_equal(read_cloud(tmp_path / "a.xyz").xyz, exact)


@pytest.mark.parametrize(
    ("text", "colours", "fields"),
    [
        ("1 2 3 0.5\n4 5 6 0.25\n", None, {"intensity": [0.5, 0.25]}),
        ("1,2,3,10,20,30\n4,5,6,255,0,0\n", [[10, 20, 30], [255, 0, 0]], {}),
        ("2\n1 2 3 -7 1 2 9\n4 5 6 8 0 0 9\n", [[1, 2, 9], [0, 0, 9]], {"intensity": [-7, 8]}),
        ("//X Y Z R G B T\n1 2 3 1 2 3 9\n4 5 6 0 0 1 8", [[1, 2, 3], [0, 0, 1]], {"T": [9, 8]}),
        ("//X Y Z R G B\n2\n1 2 3 1 2 3\n4 5 6 0 0 1", [[1, 2, 3], [0, 0, 1]], {}),
        ("# made by hand\ny;x;z;who\n2;1;3;Ann\n5;4;6;Bob\n", None, {}),
        ("\ufeffx, y, z\n1, 2, 3\n4, 5, 6", None, {}),
        ("1 2 3 \r\n4 5 6 \r\n", None, {}),
        ("1,2,3,\n4,5,6,\n", None, {}),
        ("x,y,z,\n1,2,3,\n4,5,6,\n", None, {}),
    ],
)  # fmt: skip
def test_kinds_of_text(tmp_path: Path, text: str, colours: object, fields: object) -> None:
    (tmp_path / "a.txt").write_text(text, encoding="utf-8")
    cloud = read_cloud(tmp_path / "a.txt")
    assert cloud.xyz.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert (None if cloud.colours is None else cloud.colours.tolist()) == colours
    assert {name: values.tolist() for name, values in cloud.fields.items()} == fields


def test_arrays_of_numpy(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", POINTS.astype(np.float32))
    assert np.array_equal(read_cloud(tmp_path / "a.npy").xyz, POINTS.astype(np.float32))
    np.savez_compressed(
        tmp_path / "a.npz", points=UTM, rgb=COLOURS, intensity=INTENSITY, pose=np.eye(4)
    )
    cloud = read_cloud(tmp_path / "a.npz")
    assert np.array_equal(cloud.xyz, UTM)
    assert np.array_equal(cloud.colours, COLOURS)
    assert np.array_equal(cloud.fields["intensity"], INTENSITY)
    assert set(cloud.fields) == {"intensity"}
    named = np.zeros(40, dtype=[("x", "f8"), ("y", "f8"), ("z", "f8"), ("ring", "u1")])
    named["x"] = UTM[:, 0]
    np.save(tmp_path / "b.npy", named)
    assert np.array_equal(read_cloud(tmp_path / "b.npy").xyz[:, 0], UTM[:, 0])


@pytest.mark.parametrize(
    ("rows", "columns", "is_read"),
    [(15, 16, True), (16, 17, False), (17, 17, True), (300, 256, True), (300, 257, False)],
)
def test_points_stand_in_rows(tmp_path: Path, rows: int, columns: int, is_read: bool) -> None:
    np.save(tmp_path / "a.npy", RNG.random((rows, columns)))
    if is_read:
        cloud = read_cloud(tmp_path / "a.npy")
        assert len(cloud) == rows
        assert len(cloud.fields) == columns - 3
    else:
        with pytest.raises(InputError, match=f"{columns} columns: transpose it"):
            read_cloud(tmp_path / "a.npy")


def test_the_size_of_an_unpacked_archive_is_limited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    np.savez(tmp_path / "a.npz", xyz=POINTS)
    size = len(_npy(POINTS))
    monkeypatch.setattr(content, "MOST_TIMES", 0)
    monkeypatch.setattr(content, "LEAST_LIMIT", size)
    assert np.array_equal(read_cloud(tmp_path / "a.npz").xyz, POINTS)
    monkeypatch.setattr(content, "LEAST_LIMIT", size - 1)
    with pytest.raises(InputError, match="unpacks to more than"):
        read_cloud(tmp_path / "a.npz")


def test_coarse_single_precision_coordinates_give_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """17 km away a step is 2 ** -9 m: a hundred-thousandth of 195 m."""
    for width, kind, is_told in [(190, "f4", True), (200, "f4", False), (190, "f8", False)]:
        caplog.clear()
        points = np.vstack([POINTS * 2, [[0, 0, 0], [width, 0, 0]]]) + np.array([17_000, 0, 0])
        np.save(tmp_path / "a.npy", points.astype(kind))
        read_cloud(tmp_path / "a.npy")
        assert ("in single precision" in caplog.text) == is_told


def test_frames_of_kitti_and_nuscenes(tmp_path: Path) -> None:
    rows = np.column_stack([POINTS, INTENSITY / 60_000, INTENSITY % 32]).astype("<f4")
    (tmp_path / "a.bin").write_bytes(rows[:, :4].tobytes())
    assert np.array_equal(read_cloud(tmp_path / "a.bin").fields["intensity"], rows[:, 3])
    (tmp_path / "a.pcd.bin").write_bytes(rows.tobytes())
    cloud = read_cloud(tmp_path / "a.pcd.bin")
    assert np.array_equal(cloud.xyz, rows[:, :3])
    assert np.array_equal(cloud.fields["ring"], rows[:, 4])


@pytest.mark.skipif(
    (sys.platform, platform.machine()) != ("linux", "x86_64"),
    reason="the test tools have pye57 for Linux on x86-64 alone",
)
def test_scans_of_an_e57_file_are_moved_to_their_poses(tmp_path: Path) -> None:
    import pye57

    near = POINTS.astype(np.float32).astype(np.float64)
    columns = {f"cartesian{axis}": near[:, place] for place, axis in enumerate("XYZ")}
    columns |= {f"color{name}": COLOURS[:, n] for n, name in enumerate(("Red", "Green", "Blue"))}
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        file.write_scan_raw({**columns, "intensity": INTENSITY / 60_000})
        turned = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])  # a quarter turn about z
        place = np.array([500_000.0, 5_400_000.0, 250.0])
        file.write_scan_raw(columns, rotation=turned, translation=place)
    cloud = read_cloud(tmp_path / "a.e57")
    assert np.array_equal(cloud.xyz[:40], near)
    expected = np.column_stack([-near[:, 1], near[:, 0], near[:, 2]]) + place
    assert np.abs(cloud.xyz[40:] - expected).max() < 2e-9
    assert np.array_equal(cloud.colours, np.tile(COLOURS, (2, 1)))
    assert cloud.fields["scan"].tolist() == [0] * 40 + [1] * 40


def test_without_pye57_a_message_says_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pye57", None)
    (tmp_path / "a.e57").write_bytes(b"ASTM-E57")
    with pytest.raises(InputError, match=r"a\.e57: .*pip install 'puckbench\[e57\]'"):
        parse_e57(tmp_path / "a.e57")


def _npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


BAD = {
    "a.xyz": b"",
    "b.xyz": b"1 2 3\n4 5 six\n",
    "c.csv": b"a,b,c\n1,2,3\n",
    "d.xyz": b"1 2\n3 4\n",
    "e.txt": b"1 2 3\n4 5 6 7 8\n",
    "f.npy": b"\x93NUMPY\x01\x00damaged",
    "g.npz": b"PK\x03\x04damaged",
    "h.bin": struct.pack("<4f", 1, 2, 3, 4)[:-1],
    "i.bin": struct.pack("<4f", 1, 1e9, 3, 4),
    "j.las": b"LASF",
    "k.pcd": b"# .PCD v0.7\n",
    "l.xyz": b"1 2 nan\n3 4 5\n",
    "m.xyz": b"x y z\n",
    "n.ply": b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n",
    "o.jpg": b"\xff\xd8",
    "p.pts": b"3\n1 2 3\n4 5 6\n",
    "q.npy": _npy(np.zeros((3, 4000))),
}


@pytest.mark.parametrize("name", BAD)
def test_a_damaged_file_is_named_in_one_line(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(BAD[name])
    with pytest.raises(InputError, match=name) as refusal:
        read_cloud(path)
    assert "\n" not in str(refusal.value)


def test_every_format_has_a_test() -> None:
    source = Path(__file__).read_text(encoding="utf-8")
    assert all(suffix in source for suffix in set(SUFFIXES) - {".asc", ".pts"})


def test_the_readme_lists_every_format() -> None:
    readme = Path(cloud_files.__file__).with_name("README.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"`(\.\w+)`", readme))
    assert {*SUFFIXES, *MESHES, *content.COMPRESSED} <= listed

"""`prepare`, `encode` and `evaluate` take clouds of other formats than their own PLY."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cloud_files.clouds import read_cloud
from puckbench.cli import main

STEP = 0.25
POINTS = np.random.default_rng(3).integers(0, 4000, (400, 3)) * STEP
"""Multiples of a step that all formats keep without loss."""


def write_las(path: Path) -> None:
    import laspy

    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales = np.full(3, STEP)
    las = laspy.LasData(header)
    las.x, las.y, las.z = POINTS.T
    las.write(path)


WRITERS: dict[str, Callable[[Path], None]] = {
    "las": write_las,
    "npy": lambda path: np.save(path, POINTS),
    "xyz": lambda path: np.savetxt(path, POINTS, fmt="%.2f"),
}


@pytest.fixture(params=WRITERS)
def cloud(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / f"cloud.{request.param}"
    WRITERS[request.param](path)
    return path


def answer(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    capsys.readouterr()
    assert main([*map(str, words), "--json"]) == 0
    result: dict[str, Any] = json.loads(capsys.readouterr().out)
    return result


def test_prepare_scales_it_to_the_cube(
    cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer(capsys, "prepare", cloud, tmp_path / "out.ply")
    prepared = read_cloud(tmp_path / "out.ply")
    assert prepared.normals is not None
    low, size = POINTS.min(axis=0), np.ptp(POINTS, axis=0).max()
    expected = (POINTS - low) * 1023 / size
    order = np.lexsort(expected.T), np.lexsort(prepared.xyz.T)
    assert np.abs(prepared.xyz[order[1]] - expected[order[0]]).max() < 0.51 * 2.0**-16


def test_encode_and_evaluate_take_it_as_it_is(
    cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stream = tmp_path / "cloud.bin"
    record = answer(capsys, "encode", cloud, stream, "--codec", "draco", "--rate", "r4")
    assert record["points_in"] == len(POINTS)
    np.save(tmp_path / "moved.npy", POINTS + np.array((0.0, 0.0, 0.125)))
    row = answer(capsys, "evaluate", cloud, tmp_path / "moved.npy")
    # No other point is as near as the one that was moved by half a step.
    assert row["d1_mse"] == pytest.approx(0.125**2)
    assert row["points_a"] == len(POINTS)
    row = answer(capsys, "evaluate", cloud, stream)
    assert 0 < row["d1_mse"] < 100


@pytest.fixture
def frame(tmp_path: Path) -> Path:
    """Five columns under KITTI's name, a quarter of them firings without a return."""
    rows = np.column_stack([POINTS - 500, np.full(400, 9), np.arange(400) % 32])
    rows[::4, :3] = 0
    rows.astype("<f4").tofile(tmp_path / "a.bin")
    return tmp_path / "a.bin"


def test_missing_returns_are_left_out_and_counted_from_the_file_to_the_row(
    frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cloud, stream = tmp_path / "cloud.ply", tmp_path / "a.drc"
    counts = {"dropped_points": 100, "missing_returns": 100}
    assert counts.items() <= answer(capsys, "prepare", frame, cloud).items()
    assert len(read_cloud(cloud)) == 300
    answer(capsys, "encode", cloud, stream, "--codec", "draco", "--rate", "r4")
    assert counts.items() <= answer(capsys, "evaluate", cloud, stream).items()
    record = answer(capsys, "encode", frame, stream, "--codec", "draco", "--rate", "r4")
    assert record["points_in"] == 300
    row = answer(capsys, "evaluate", frame, stream)
    assert counts.items() <= row.items()
    assert row["points_a"] == 300


def test_missing_returns_are_kept_when_asked(
    frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["prepare", frame, tmp_path / "cloud.ply", "--keep-missing", "--bin-columns", "5"]
    assert answer(capsys, *words)["points"] == 400
    assert main([*map(str, words)]) == 0
    assert "missing_returns" not in capsys.readouterr().out
    assert len(read_cloud(tmp_path / "cloud.ply")) == 400


def test_a_remark_says_what_was_left_out(
    frame: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["prepare", str(frame), str(tmp_path / "cloud.ply")]) == 0
    result = capsys.readouterr()
    assert result.err == (
        f"puckbench: {frame}: 100 of 400 points are missing returns "
        "(--keep-missing keeps them): left out\n"
    )
    assert "missing_returns" in result.out


def test_columns_of_a_frame_are_named_where_values_do_not_tell(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "a.bin", tmp_path / "cloud.ply"
    np.random.default_rng(1).random(60).astype("<f4").tofile(path)
    assert main(["prepare", str(path), str(out)]) == 2
    assert "may have 3 or 4 values each" in capsys.readouterr().err
    assert answer(capsys, "prepare", path, out, "--bin-columns", "x,y,z,_")["points"] == 15


def test_a_file_of_an_unknown_name_is_a_recording_only_if_it_begins_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "a.data", tmp_path / "cloud.ply"
    path.write_bytes(b"1 2 3\n")
    assert main(["prepare", str(path), str(out)]) == 2
    assert "not a point cloud by its name (.ply, " in capsys.readouterr().err
    section = b"\x0a\x0d\x0d\x0a\x1c\0\0\0\x4d\x3c\x2b\x1a"
    for mark in (b"\xd4\xc3\xb2\xa1\2\0\4\0", section, b"#ROSBAG V2.0\n"):
        path.write_bytes(mark + bytes(40))
        assert main(["prepare", str(path), str(out)]) == 2
        assert "point cloud by its name" not in capsys.readouterr().err
    assert main(["prepare", str(tmp_path / "b.data"), str(out)]) == 2
    assert "no such file" in capsys.readouterr().err


def test_a_text_with_a_german_header_is_prepared(tmp_path: Path) -> None:
    rows = "".join(f"{x:.3f},{y:.3f},{z:.3f},7\n" for x, y, z in POINTS)
    (tmp_path / "a.csv").write_bytes(f"x,y,z,Intensität\n{rows}".encode("latin-1"))
    assert main(["prepare", str(tmp_path / "a.csv"), str(tmp_path / "b.ply")]) == 0
    assert (read_cloud(tmp_path / "b.ply").fields["Intensitat"] == 7).all()


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.xyz", b"1 2 3\n4 5 six\n"),
        ("b.npz", b"PK\x03\x04damaged"),
        ("c.las", b"LASF"),
        ("d.xyz", b"1 2 nan\n3 4 5\n"),
        ("e.jpg", b"\xff\xd8"),
        ("f.ply", b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n"),
    ],
)
def test_a_damaged_file_is_named_in_one_line(
    name: str, data: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    words = ["encode", str(path), str(tmp_path / "o.out"), "--codec", "draco", "--rate", "r1"]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert name in error
    assert error.count("\n") == 1

"""Drives: the archive, poses between turns, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cloud_files.poses import poses_of, read_kitti_calibration, read_poses, tum_bytes
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.returns import Beams, Returns
from pointkit.lidar.turns import Layout, Turn
from puckbench.recordings.drives import Drive, firing_shares, read_drive, turn_of, write_drive


def curved_poses(count: int, step_m: float = 1.0, step_deg: float = 2.0) -> np.ndarray:
    step = np.eye(4)
    step[:3, :3] = Rotation.from_euler("z", step_deg, degrees=True).as_matrix()
    step[0, 3] = step_m
    poses = [np.eye(4)]
    while len(poses) < count:
        poses.append(poses[-1] @ step)
    return np.array(poses)


def one_turn(columns: int = 720) -> Returns:
    azimuths = (np.arange(columns) * (36000 // columns)).astype(np.uint16)
    ranges = np.full((1, columns, 2), 5000, np.uint16)
    beams = Beams((-1.0, 1.0), (0.0, 0.0), (0.0, 0.5))
    return Returns(beams, Layout((0, 1)), (Turn(ranges, azimuths),))


def small_drive() -> Drive:
    times = np.arange(5) / 20
    turns = (turn_of(one_turn()), PointCloud(np.eye(3)))
    return Drive(turns, times[:-1:2], 0.1, times, curved_poses(5), {"scene": "street"})


def test_archive_returns_the_drive_and_tum_poses(tmp_path: Path) -> None:
    drive, path = small_drive(), tmp_path / "drive.zip"
    write_drive(path, drive)
    first = path.read_bytes()
    write_drive(path, drive)
    assert path.read_bytes() == first
    again = read_drive(path)
    np.testing.assert_allclose(again.poses, drive.poses, atol=1e-8)
    np.testing.assert_array_equal(again.starts, drive.starts)
    assert again.about == drive.about
    np.testing.assert_array_equal(again.turns[0].xyz, drive.turns[0].xyz)
    assert again.turns[0].returns is not None
    np.testing.assert_array_equal(again.turns[1].xyz, np.eye(3))
    assert again.turns[1].returns is None


def test_poses_between_times_lie_on_the_arc() -> None:
    """Half of a step of 2 degrees and 1 m along z's rotation is 1 degree."""
    drive = small_drive()
    halfway = drive.poses_at(0.25)
    turned = Rotation.from_matrix(halfway[:, :3, :3]).as_euler("xyz", degrees=True)
    np.testing.assert_allclose(turned[:, 2], [1.0, 5.0], atol=1e-9)
    np.testing.assert_allclose(drive.poses_at(1.0), drive.poses[2::2], atol=1e-12)


def test_firings_pass_evenly_through_a_turn() -> None:
    """720 columns; the second laser fires half a column after the first."""
    shares = firing_shares(one_turn())
    np.testing.assert_allclose(shares, np.arange(1440) / 1440, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"turns": small_drive().turns[:1], "starts": np.zeros(1)}, "1 turns and 1 times"),
        ({"starts": np.array([0.1, 0.0])}, "times run back: turn 1"),
        ({"pose_times": np.arange(5) / 40}, "poses from 0 to 0.1 s, turns from 0 to 0.2 s"),
    ],
)
def test_faulty_drives_are_refused_in_one_line(changes: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(small_drive(), **changes)


def test_gap_between_turns_is_refused() -> None:
    turns = (PointCloud(np.eye(3)),) * 4
    starts = np.array([0.0, 0.1, 0.2, 0.5])
    with pytest.raises(InputError, match=r"a gap after turn 2: 0.3 s instead of 0.1 s"):
        Drive(turns, starts, 0.1, np.array([0.0, 1.0]), curved_poses(2))


def test_tum_and_kitti_files_give_the_same_poses(tmp_path: Path) -> None:
    poses, times = curved_poses(4), np.arange(4.0)
    tum, kitti = tmp_path / "a.tum", tmp_path / "00.txt"
    tum.write_bytes(b"# t x y z qx qy qz qw\n" + tum_bytes(times, poses))
    kitti.write_text("\n".join(" ".join(map(repr, p[:3].ravel().tolist())) for p in poses))
    read_times, from_tum = read_poses(tum)
    assert read_times is not None
    np.testing.assert_array_equal(read_times, times)
    np.testing.assert_allclose(from_tum, poses, atol=1e-8)
    np.testing.assert_allclose(read_poses(kitti)[1], poses, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no poses"),
        ("1 2 3\n", "no poses"),
        ("0 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n", "times run back: pose 2"),
        ("0 0 0 0 0 0 0 2\n", "length 1"),
        ("0 0 0 0 0 0 0 nan\n", "line 1 has a number that is not finite"),
        ("a b\n", "line 1 is not a row of numbers"),
        ("2 0 0 0 0 1 0 0 0 0 1 0\n", "not a rotation"),
    ],
)
def test_damaged_poses_are_refused_in_one_line(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        poses_of(text.encode())


def test_calibration_is_that_of_the_lidar(tmp_path: Path) -> None:
    file = tmp_path / "calib.txt"
    file.write_text("P0: 1 0 0 0 0 1 0 0 0 0 1 0\nTr: 0 -1 0 1 0 0 -1 2 1 0 0 3\n")
    assert read_kitti_calibration(file)[0].tolist() == [0, -1, 0, 1]
    file.write_text("P0: 1\n")
    with pytest.raises(InputError, match="no line 'Tr:'"):
        read_kitti_calibration(file)

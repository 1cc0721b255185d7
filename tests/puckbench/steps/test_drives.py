"""Drives of data sets: KITTI's poses, poses by path, and none."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cloud_files.poses import read_lidar_poses, tum_bytes
from pointkit.errors import InputError
from puckbench.metrics.tasks.odometry import estimated_poses
from puckbench.recordings.drives import read_drive
from puckbench.steps.drive_of_clouds import DriveOfClouds

TURNS = 4
CAMERA = np.array([[0.0, -1, 0, 0.1], [0, 0, -1, -0.2], [1, 0, 0, 0.3], [0, 0, 0, 1]])


def lidar_poses() -> np.ndarray:
    poses = np.tile(np.eye(4), (TURNS, 1, 1))
    turned = Rotation.from_euler("z", np.arange(TURNS)[:, None] * 3.0, degrees=True)
    poses[:, :3, :3], poses[:, 0, 3] = turned.as_matrix(), 0.5 * np.arange(TURNS)
    return poses


def rows_of(matrices: np.ndarray) -> str:
    return "\n".join(" ".join(map(repr, each[:3].ravel().tolist())) for each in matrices) + "\n"


@pytest.fixture
def kitti(tmp_path: Path) -> Path:
    """Frames of the walls of a hall, from four poses, laid out as the odometry benchmark is."""
    rng = np.random.default_rng(0)
    walls = rng.uniform(-15, 15, (20_000, 3))
    walls[:, 2] = np.abs(walls[:, 2]) / 4
    side, rows = rng.integers(0, 3, 20_000), np.arange(20_000)
    walls[rows, side] = np.where(side == 2, 0.0, np.sign(walls[rows, side]) * 15)
    sequence = tmp_path / "sequences" / "00"
    (sequence / "velodyne").mkdir(parents=True)
    for number, pose in enumerate(lidar_poses()):
        points = (walls - pose[:3, 3]) @ pose[:3, :3]
        frame = np.column_stack([points, np.zeros(len(points))]).astype("<f4")
        (sequence / "velodyne" / f"{number:06d}.bin").write_bytes(frame.tobytes())
    (sequence / "times.txt").write_text("".join(f"{0.1 * k:e}\n" for k in range(TURNS)))
    (sequence / "calib.txt").write_text("Tr: " + rows_of(CAMERA[None]))
    (tmp_path / "poses").mkdir()
    camera_poses = CAMERA @ lidar_poses() @ np.linalg.inv(CAMERA)
    (tmp_path / "poses" / "00.txt").write_text(rows_of(camera_poses))
    return tmp_path


def job(folder: Path, poses: str | None = None, **more: Any) -> DriveOfClouds:
    names = tuple(f"00_{number:06d}" for number in range(TURNS))
    settings = {"loader": "kitti", "names": names, "options": {"path": str(folder)}}
    return DriveOfClouds(**settings, poses=poses, **more)


def test_kitti_drive_has_the_poses_of_its_lidar(kitti: Path) -> None:
    job(kitti).run(kitti / "drive.zip")
    drive = read_drive(kitti / "drive.zip")
    np.testing.assert_allclose(drive.poses_at(0.5), lidar_poses(), atol=1e-7)
    np.testing.assert_allclose(drive.starts, 0.1 * np.arange(TURNS), atol=1e-9)
    assert (drive.turn_s, drive.about["poses"]) == (0.0, "of the data set")


def test_without_poses_odometry_gives_them(kitti: Path) -> None:
    (kitti / "poses" / "00.txt").unlink()
    job(kitti).run(kitti / "drive.zip")
    drive = read_drive(kitti / "drive.zip")
    assert drive.about["poses"] == "KISS-ICP on the undecoded turns"
    moved = np.linalg.norm(drive.poses_at(0.5)[-1, :3, 3])
    assert moved == pytest.approx(1.5, abs=0.3)


def test_reference_without_poses_has_the_options_of_the_task(kitti: Path) -> None:
    """So the undecoded turns deviate from it by nothing."""
    (kitti / "poses" / "00.txt").unlink()
    options = {"max_range_m": 20.0, "voxel_m": 0.3}
    job(kitti, odometry={**options, "skip": 2}).run(kitti / "drive.zip")
    drive = read_drive(kitti / "drive.zip")
    again = estimated_poses(drive.turns, False, **options)
    np.testing.assert_allclose(drive.poses_at(0.5), again, atol=1e-7)
    assert not np.allclose(estimated_poses(drive.turns, False, 100.0, 1.0), again, atol=1e-4)


def test_poses_of_kittis_camera_by_path_are_turned_to_the_lidar(kitti: Path) -> None:
    """They move along z; the calibration is beside them, or in KITTI's own folders."""
    (kitti / "poses").rename(kitti / "mine")
    file = kitti / "mine" / "00.txt"
    job(kitti, str(file)).run(kitti / "drive.zip")
    np.testing.assert_allclose(
        read_drive(kitti / "drive.zip").poses_at(0.5), lidar_poses(), atol=1e-7
    )
    moved = kitti / "elsewhere" / "here" / "00.txt"
    moved.parent.mkdir(parents=True)
    file.rename(moved)
    with pytest.raises(InputError, match=r"00.txt: these poses move along z, .*calib.txt"):
        job(kitti, str(moved)).run(kitti / "drive.zip")
    moved.write_text(rows_of(lidar_poses()))
    job(kitti, str(moved)).run(kitti / "drive.zip")
    np.testing.assert_allclose(
        read_drive(kitti / "drive.zip").poses_at(0.5), lidar_poses(), atol=1e-7
    )


def test_semantickittis_poses_are_those_of_the_data_set(kitti: Path) -> None:
    (kitti / "poses" / "00.txt").rename(kitti / "sequences" / "00" / "poses.txt")
    job(kitti).run(kitti / "drive.zip")
    drive = read_drive(kitti / "drive.zip")
    np.testing.assert_allclose(drive.poses_at(0.5), lidar_poses(), atol=1e-7)
    assert drive.about["poses"] == "of the data set"


@pytest.mark.parametrize("form", ["KITTI", "TUM"])
def test_a_camera_moves_along_its_own_z_axis_wherever_it_goes(tmp_path: Path, form: str) -> None:
    """After a bend to the right, a camera of KITTI moves along x of its first pose."""
    lidar = np.tile(np.eye(4), (40, 1, 1))
    lidar[:, :3, :3] = Rotation.from_euler("z", -90, degrees=True).as_matrix()
    lidar[:5, :3, :3] = np.eye(3)
    lidar[:5, 0, 3], lidar[5:, 0, 3], lidar[5:, 1, 3] = np.arange(5), 4, -np.arange(1, 36)
    file = tmp_path / "00.txt"

    def write(poses: np.ndarray) -> None:
        tum = tum_bytes(np.arange(40.0), poses)
        file.write_bytes(tum if form == "TUM" else rows_of(poses).encode())

    write(CAMERA @ lidar @ np.linalg.inv(CAMERA))
    with pytest.raises(InputError, match=r"00.txt: these poses move along z, .*calib.txt"):
        read_lidar_poses(file)
    (tmp_path / "calib.txt").write_text("Tr: " + rows_of(CAMERA[None]))
    np.testing.assert_allclose(read_lidar_poses(file)[1], lidar, atol=1e-6)
    write(lidar)
    np.testing.assert_allclose(read_lidar_poses(file)[1], lidar, atol=1e-6)


def test_poses_of_another_length_and_times_that_run_back_are_refused(kitti: Path) -> None:
    file = kitti / "three.txt"
    file.write_text(rows_of(lidar_poses()[:3]))
    with pytest.raises(InputError, match=r"three.txt: 3 poses for 4 turns"):
        job(kitti, str(file)).run(kitti / "drive.zip")
    (kitti / "sequences" / "00" / "times.txt").write_text("0\n0.2\n0.1\n0.3\n")
    with pytest.raises(InputError, match="times run back: turn 2 begins before turn 1"):
        job(kitti).run(kitti / "drive.zip")
    assert not (kitti / "drive.zip").exists()

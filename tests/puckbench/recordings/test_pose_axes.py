"""Axes of poses: found from the walls that a moving sensor sees, converted, or told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cloud_files.pcd import write_pcd
from cloud_files.poses import read_poses, tum_bytes
from puckbench.recordings.drives import read_drive
from puckbench.recordings.frames import Frame, PoseFile, write_frames
from puckbench.recordings.pose_axes import (
    axes_of_poses,
    in_axes_of_turns,
    pairs_apart,
    turned_about_z,
    walls_of,
)
from puckbench.steps.drive_of_clouds import DriveOfClouds

TURNS, APART_S, FIRST_S = 12, 0.1, 1.6e9
RANDOM = np.random.default_rng(5)


def way() -> np.ndarray:
    """Poses of a sensor that goes forward, along y, by 0.6 m each turn, and bends to the left."""
    step = turned_about_z(3.0)
    step[1, 3] = 0.6
    poses = [np.eye(4)]
    while len(poses) < TURNS:
        poses.append(poses[-1] @ step)
    return np.array(poses)


def street() -> np.ndarray:
    """Points on the fronts of houses of different depths, and on the ground."""
    corners = RANDOM.uniform(-20, 25, (30, 2))
    corners = corners[np.linalg.norm(corners, axis=1) > 6]
    ends = corners + RANDOM.uniform(-4, 4, corners.shape)
    along = RANDOM.random((len(corners), 400, 1))
    fronts = (corners[:, None] + along * (ends - corners)[:, None]).reshape(-1, 2)
    walls = np.column_stack([fronts, RANDOM.uniform(-1.5, 2, len(fronts))])
    ground = np.column_stack([RANDOM.uniform(-25, 25, (4000, 2)), np.full(4000, -1.7)])
    return np.concatenate([walls, ground])


def tunnel() -> np.ndarray:
    """Walls on both sides that run on as far as the sensor sees."""
    y, z = RANDOM.uniform(-300, 300, 300_000), RANDOM.uniform(-1.5, 2, 300_000)
    return np.column_stack([RANDOM.choice([-3.0, 3.0], len(y)), y, z])


def seen(world: np.ndarray, poses: np.ndarray) -> list[np.ndarray]:
    turns = [(world - pose[:3, 3]) @ pose[:3, :3] for pose in poses]
    return [turn + RANDOM.normal(0, 0.01, turn.shape) for turn in turns]


def found(poses: np.ndarray, turns: list[np.ndarray]) -> float | None:
    pairs = pairs_apart(poses)
    walls = {number: walls_of(turns[number]) for pair in pairs for number in pair}
    return axes_of_poses(poses, walls, pairs).turned_deg


@pytest.mark.parametrize("degrees", [0, -90, 90, 180])
def test_axes_turned_by_right_angles_are_found(degrees: float) -> None:
    """The turn from the poses' axes to those of the turns is what was applied to the poses."""
    turns = seen(street(), way())
    poses = way() @ np.linalg.inv(turned_about_z(degrees))
    angle = found(poses, turns)
    assert angle is not None
    assert angle % 360 == degrees % 360
    world = turned_about_z(70.0)  # fixed coordinates may have any axes
    world[:3, 3] = [500, -300, 20]
    assert found(world @ poses, turns) == angle


def test_other_angles_are_told_and_the_poses_kept(caplog: pytest.LogCaptureFixture) -> None:
    poses = way() @ turned_about_z(-35.0)
    turns, pairs = seen(street(), way()), pairs_apart(poses)
    walls = {number: walls_of(turns[number]) for pair in pairs for number in pair}
    matrix, remark = in_axes_of_turns("mine.tum", poses, walls, pairs)
    assert np.array_equal(matrix, np.eye(4))
    assert remark.startswith("its axes are about 35 degrees about z off")
    assert caplog.messages == [f"mine.tum: {remark}"]


def test_a_tunnel_does_not_show_the_axes_and_a_sensor_at_rest_says_nothing() -> None:
    straight = np.tile(np.eye(4), (TURNS, 1, 1))
    straight[:, 1, 3] = 0.6 * np.arange(TURNS)
    near = [turn[np.abs(turn[:, 1]) < 60] for turn in seen(tunnel(), straight)]
    for degrees in (0, 90, 180):  # forward and back look alike
        assert found(straight @ turned_about_z(degrees), near) is None
    at_rest = np.tile(np.eye(4), (TURNS, 1, 1))
    assert pairs_apart(at_rest) == []
    assert not axes_of_poses(at_rest, {}, []).is_known


def in_ros(poses: np.ndarray) -> np.ndarray:
    """The same poses for axes x forward, y left: x of the new axes is y of the old ones."""
    turned = Rotation.from_matrix([[0, -1, 0], [1, 0, 0], [0, 0, 1]]).as_matrix()
    return np.concatenate([poses[:, :, :3] @ turned, poses[:, :, 3:]], axis=2)


def test_a_drive_with_poses_of_ros_has_those_of_its_turns(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for number, turn in enumerate(seen(street(), way())):
        write_pcd(folder / f"{number:06d}.pcd", dict(zip("xyz", turn.T, strict=True)))
    times = FIRST_S + APART_S * np.arange(TURNS)
    (folder / "times.txt").write_text("".join(f"{time:.6f}\n" for time in times))
    (tmp_path / "ros.tum").write_bytes(tum_bytes(times, in_ros(way())))
    step = DriveOfClouds(
        loader="point_clouds",
        names=tuple(f"{number:06d}" for number in range(TURNS)),
        options={"path": str(folder)},
        poses=str(tmp_path / "ros.tum"),
    )
    step.run(tmp_path / "drive.zip")
    drive = read_drive(tmp_path / "drive.zip")
    np.testing.assert_allclose(drive.poses_at(0.0), way(), atol=1e-6)
    assert drive.starts[0] == FIRST_S
    remark = "converted from ROS's axes (x forward), by -90 degrees about z"
    assert drive.about["poses"] == f"ros.tum: {remark}"
    assert any(line.endswith(f"ros.tum: {remark}") for line in caplog.messages)


def test_frames_get_poses_of_a_file_at_their_times_and_in_their_axes(tmp_path: Path) -> None:
    """The file has five poses for each frame, in ROS's axes, and begins before the frames."""
    seconds = APART_S * np.arange(TURNS)
    turns = seen(street(), way())
    frames = [
        Frame(float(time), dict(zip("xyz", turn.T, strict=True)))
        for time, turn in zip(seconds, turns, strict=True)
    ]
    step = turned_about_z(3.0 / 5)
    step[1, 3] = 0.6 / 5  # nearly the same arc
    fine = [np.eye(4)]
    while len(fine) < 5 * TURNS:
        fine.append(fine[-1] @ step)
    times = FIRST_S + APART_S / 5 * np.arange(5 * TURNS)
    (tmp_path / "ros.tum").write_bytes(tum_bytes(times, in_ros(np.array(fine))))
    pose_file = PoseFile(tmp_path / "ros.tum", FIRST_S)
    write_frames(tmp_path / "frames", "pcd", frames, TURNS, pose_file)
    _, poses = read_poses(tmp_path / "frames" / "poses.txt")
    np.testing.assert_allclose(poses, np.array(fine)[::5], atol=1e-5)
    again, same = read_poses(tmp_path / "frames" / "poses.tum")
    np.testing.assert_allclose(again, seconds, atol=1e-6)
    np.testing.assert_allclose(same, poses, atol=1e-8)

"""Registration from unknown poses, on a drive whose motions are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pointkit.geometry.cloud import PointCloud
from puckbench.metrics.tasks.global_registration import global_registration
from puckbench.metrics.tasks.registration import motion_errors, pairs_apart
from puckbench.recordings.drives import Drive

pytest.importorskip("kiss_matcher")
VOXEL_M = 0.8


@pytest.fixture(scope="module")
def drive() -> Drive:
    """Five turns, 2.5 m and 5 degrees apart, among 25 houses at random places on level ground."""
    rng = np.random.default_rng(0)
    parts = [np.column_stack([rng.uniform(-30, 30, (6_000, 2)), np.zeros(6_000)])]
    for middle in rng.uniform(-28, 28, (25, 2)):
        wall, side = rng.uniform(-1, 1, (900, 2)), rng.integers(0, 2, 900)
        wall[np.arange(900), side] = np.sign(wall[np.arange(900), side])
        turned = Rotation.from_euler("z", rng.uniform(0, 90), degrees=True).as_matrix()[:2, :2]
        wall = wall * rng.uniform(1, 5, 2) @ turned.T + middle
        parts.append(np.column_stack([wall, rng.uniform(0, rng.uniform(2, 8), 900)]))
    points = np.vstack(parts)
    poses = np.tile(np.eye(4), (5, 1, 1))
    turned = Rotation.from_euler("z", 5.0 * np.arange(5)[:, None], degrees=True)
    poses[:, :3, :3], poses[:, 0, 3], poses[:, 2, 3] = turned.as_matrix(), 2.5 * np.arange(5), 1.7
    turns = tuple(
        PointCloud((points[rng.random(len(points)) < 0.5] - pose[:3, 3]) @ pose[:3, :3])
        for pose in poses
    )
    times = np.arange(5) / 10
    return Drive(turns, times, 0.0, times, poses)


def test_pairs_are_registered_from_unknown_poses(drive: Drive) -> None:
    results = global_registration(drive, drive.turns, pairs=1, voxel_m=VOXEL_M)
    for apart in (2, 5, 10):
        assert results[f"global_registration_{apart}m_percent"] == 100
        assert results[f"global_registration_{apart}m_error_m"] < VOXEL_M
    assert global_registration(drive, drive.turns, pairs=1, voxel_m=VOXEL_M) == results


def test_other_poses_are_no_success(drive: Drive) -> None:
    """The true motions are longer by 4 m a turn than those between the clouds."""
    poses = drive.poses.copy()
    poses[:, 1, 3] += 4.0 * np.arange(5)
    wrong = replace(drive, poses=poses)
    results = global_registration(wrong, drive.turns, pairs=1, voxel_m=VOXEL_M)
    assert results["global_registration_5m_percent"] == 0
    assert "global_registration_5m_error_m" not in results


@pytest.mark.parametrize("points", [np.arange(12.0).reshape(4, 3), np.zeros((1, 3))])
def test_clouds_without_features_are_not_registered(drive: Drive, points: np.ndarray) -> None:
    """KISS-Matcher itself crashes without any feature."""
    few = [PointCloud(points) for _ in drive.turns]
    results = global_registration(drive, few, pairs=1)
    assert results["global_registration_5m_percent"] == 0
    assert "global_registration_5m_error_m" not in results


def test_pairs_are_as_far_apart_as_told(drive: Drive) -> None:
    assert pairs_apart(drive.poses, 5, 8) == [(0, 2), (1, 3), (2, 4)]
    assert pairs_apart(drive.poses, 10, 8) == [(0, 4), (1, 4)]
    assert pairs_apart(drive.poses, 40, 8) == []


def test_errors_of_a_motion_are_its_difference_to_the_true_one() -> None:
    true, off = np.eye(4), np.eye(4)
    true[:3, :3], true[:3, 3] = Rotation.random(rng=1).as_matrix(), (5.0, -3.0, 2.0)
    off[:3, :3] = Rotation.from_euler("x", 7, degrees=True).as_matrix()
    off[:3, 3] = (0.3, 0.0, 0.4)
    error_m, error_deg = motion_errors(true, true @ off)
    assert (error_m, error_deg) == (pytest.approx(0.5), pytest.approx(7))

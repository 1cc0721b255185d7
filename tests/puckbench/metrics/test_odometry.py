"""Errors of poses against closed forms; odometries and registration on clouds of exact motion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import fractional_matrix_power
from scipy.spatial.transform import Rotation

from cloud_files.poses import poses_of
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.metrics.task_registry import task_results
from puckbench.metrics.tasks.odometry import at_end_of_turn, gicp_odometry, odometry, pose_errors
from puckbench.metrics.tasks.registration import registration
from puckbench.recordings.drives import Drive

STRAIGHT = np.tile(np.eye(4), (121, 1, 1))
STRAIGHT[:, 0, 3] = np.arange(121.0)


def test_scaled_path_drifts_by_the_scale_at_every_length() -> None:
    estimated = STRAIGHT.copy()
    estimated[:, 0, 3] *= 1.01
    errors = pose_errors(STRAIGHT, estimated)
    for name in ("drift", "drift_10m", "drift_50m", "kitti", "kitti_100m"):
        assert errors[f"{name}_percent"] == pytest.approx(1.0)
        assert errors[f"{name}_deg_per_m"] == pytest.approx(0.0, abs=1e-6)
    assert "kitti_200m_percent" not in errors
    assert errors["ate_m"] == pytest.approx(0.01 * np.arange(121).std())
    assert (errors["lost_turns"], errors["length_m"]) == (0, 120)


def test_turning_estimate_drifts_by_its_rate() -> None:
    """The estimate rotates in place by 0.01 degrees a metre, beside the true motion."""
    estimated = STRAIGHT.copy()
    turned = Rotation.from_euler("z", 0.01 * np.arange(121)[:, None], degrees=True)
    estimated[:, :3, :3] = turned.as_matrix()
    assert pose_errors(STRAIGHT, estimated)["drift_deg_per_m"] == pytest.approx(0.01)


def test_another_world_frame_is_no_error_and_a_jump_is_one_lost_turn() -> None:
    moved = np.eye(4)
    moved[:3, :3], moved[:3, 3] = Rotation.random(rng=1).as_matrix(), (5.0, -3.0, 2.0)
    estimated = moved @ STRAIGHT
    errors = pose_errors(STRAIGHT, estimated)
    assert errors["ate_m"] == pytest.approx(0.0, abs=1e-9)
    assert errors["drift_percent"] == pytest.approx(0.0, abs=1e-6)
    estimated[60:, :3, 3] += 1.0
    assert pose_errors(STRAIGHT, estimated)["lost_turns"] == 1


@pytest.mark.parametrize("step_m", [0.33, 1.5])
def test_an_estimate_that_stands_still_loses_every_turn(step_m: float) -> None:
    """A turn that moves by 0.33 m is lost too, though its error is below 0.5 m."""
    true = STRAIGHT.copy()
    true[:, 0, 3] *= step_m
    still = np.tile(np.eye(4), (121, 1, 1))
    assert pose_errors(true, still)["lost_turns"] == 120
    assert pose_errors(still, still)["lost_turns"] == 0
    slower = true.copy()
    slower[:, 0, 3] *= 0.8
    assert pose_errors(true, slower)["lost_turns"] == 0


@pytest.mark.parametrize("step_m", [0.03, 0.09])
def test_an_estimate_that_stands_still_on_a_slow_drive_is_lost(step_m: float) -> None:
    """0.1 m take 4 turns of 0.03 m, and 2 of 0.09 m; errors of 0.04 m to the side lose no turn."""
    true = STRAIGHT.copy()
    true[:, 0, 3] *= step_m
    still = np.tile(np.eye(4), (121, 1, 1))
    within = {0.03: 3, 0.09: 0}[step_m]  # turns at the start, over which it moves by less
    assert pose_errors(true, still)["lost_turns"] == 120 - within
    noisy = true.copy()
    noisy[::2, 1, 3] += 0.04
    assert pose_errors(true, noisy)["lost_turns"] == 0
    assert pose_errors(still, noisy * 0.001 + still * 0.999)["lost_turns"] == 0


def test_short_drives_drift_over_shorter_lengths() -> None:
    estimated = STRAIGHT[:13].copy()
    estimated[:, 0, 3] *= 1.02
    errors = pose_errors(STRAIGHT[:13], estimated)
    for length in (1, 2, 5):
        assert errors[f"drift_{length}m_percent"] == pytest.approx(2.0)
    assert "drift_percent" not in errors
    assert "drift_5m_percent" not in pose_errors(STRAIGHT[:9], STRAIGHT[:9])
    assert "drift_5m_percent" not in pose_errors(STRAIGHT, STRAIGHT)
    still = np.tile(np.eye(4), (3, 1, 1))
    assert pose_errors(still, still)["ate_m"] == pytest.approx(0, abs=1e-12)


def test_a_length_needs_a_path_of_twice_this_length() -> None:
    """On a path of 30 m, pairs 20 m apart overlap almost wholly."""
    errors = pose_errors(STRAIGHT[:31], STRAIGHT[:31])
    assert "drift_10m_percent" in errors
    assert "drift_20m_percent" not in errors
    assert "drift_percent" not in pose_errors(STRAIGHT[:13], STRAIGHT[:13])


@pytest.mark.parametrize("degrees", [0.0, 25.0])
def test_points_come_to_the_end_of_the_turn_along_its_motion(degrees: float) -> None:
    """The motion of a share of a turn is the matrix power of the turn's motion."""
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec([0.1, -0.2, degrees], degrees=True).as_matrix()
    motion[:3, 3] = (1.5, 0.4, -0.1)
    points, shares = np.random.default_rng(0).normal(size=(5, 3)), np.linspace(0, 1, 5)
    for point, share, moved in zip(
        points, shares, at_end_of_turn(points, shares, motion), strict=True
    ):
        backwards = fractional_matrix_power(motion, share - 1)
        np.testing.assert_allclose(moved, (backwards @ [*point, 1.0])[:3], atol=1e-9)


@pytest.fixture(scope="module")
def hall() -> Drive:
    """Turns in a hall of 40 m with pillars, seen from poses 0.5 m and 1 degree apart."""
    rng = np.random.default_rng(0)
    walls = rng.uniform(-20, 20, (40_000, 3))
    side = rng.integers(0, 2, 40_000)
    walls[np.arange(40_000), side] = np.sign(walls[np.arange(40_000), side]) * 20
    walls[:, 2] = rng.uniform(0, 5, 40_000)
    floor = np.column_stack([rng.uniform(-20, 20, (20_000, 2)), np.zeros(20_000)])
    pillars = rng.uniform(-15, 15, (12, 2))[rng.integers(0, 12, 10_000)]
    points = np.vstack([walls, floor, np.column_stack([pillars, rng.uniform(0, 5, 10_000)])])
    poses = np.tile(np.eye(4), (16, 1, 1))
    turned = Rotation.from_euler("z", np.arange(16.0)[:, None], degrees=True)
    poses[:, :3, :3], poses[:, 0, 3] = turned.as_matrix(), 0.5 * np.arange(16) - 4
    poses[:, 2, 3] = 1.5
    seen = [points[rng.permutation(len(points))[:12_000]] for _ in poses]
    turns = tuple(
        PointCloud((each - pose[:3, 3]) @ pose[:3, :3])
        for each, pose in zip(seen, poses, strict=True)
    )
    times = np.arange(16) / 10
    return Drive(turns, times, 0.0, times, poses)


def test_odometry_follows_an_exact_motion(hall: Drive) -> None:
    results = odometry(hall, hall.turns, max_range_m=60, skip=5)
    assert results["lost_turns"] == 0
    assert results["ate_m"] < 0.05
    assert results["odometry_voxel_m"] == 0.6
    assert odometry(hall, hall.turns, max_range_m=60, skip=5) == results
    with pytest.raises(InputError, match="task odometry: 16 turns, of which it skips 15"):
        odometry(hall, hall.turns, skip=15)
    times, poses = poses_of(results["kiss_icp.tum"])
    np.testing.assert_allclose(times, hall.starts)
    np.testing.assert_allclose(poses, hall.poses_at(0.5), atol=0.1)


def test_by_default_half_of_a_short_drive_counts(hall: Drive) -> None:
    short = replace(hall, turns=hall.turns[:3], starts=hall.starts[:3])
    assert odometry(hall, hall.turns)["odometry_skip"] == 8
    assert odometry(short, short.turns)["odometry_skip"] == 1
    assert gicp_odometry(short, short.turns)["gicp_skip"] == 1


def test_gicp_follows_an_exact_motion(hall: Drive) -> None:
    results = gicp_odometry(hall, hall.turns, skip=5)
    assert results["gicp_lost_turns"] == 0
    assert results["gicp_ate_m"] < 0.05
    assert gicp_odometry(hall, hall.turns, skip=5) == results


def test_registration_finds_pairs_of_an_exact_motion(hall: Drive) -> None:
    results = registration(hall, hall.turns, pairs=2)
    assert results["registration_1m_percent"] == 100
    assert results["registration_1m_error_m"] < 0.05
    elsewhere = [PointCloud(turn.xyz[:3000, [1, 2, 0]] * 3) for turn in hall.turns[::-1]]
    assert registration(hall, elsewhere, pairs=2)["registration_5m_percent"] == 0


def test_unknown_tasks_and_options_are_refused(hall: Drive) -> None:
    with pytest.raises(InputError, match="unknown task 'mapping'"):
        task_results({"mapping": {}}, hall, hall.turns, ())
    with pytest.raises(InputError, match=r"task odometry: options: .*'voxels'"):
        task_results({"odometry": {"voxels": 1}}, hall, hall.turns, ())
    with pytest.raises(InputError, match="the column 'ate_m' exists already"):
        task_results({"odometry": {"skip": 5}}, hall, hall.turns, ("ate_m",))

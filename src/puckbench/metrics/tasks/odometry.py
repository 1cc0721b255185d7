"""Odometry by KISS-ICP on decoded turns, and errors against the sensor's true poses.

References
----------
I. Vizzo et al., "KISS-ICP: In Defense of Point-to-Point ICP", RA-L 2023.
A. Geiger et al., "Are we ready for Autonomous Driving?", CVPR 2012 (errors over lengths).
M. Grupp, evo, github.com/MichaelGrupp/evo.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.lidar.drives import Drive, firing_shares
from puckbench.metrics.task_registry import TASKS

LENGTHS_M = (10, 20, 50)
KITTI_LENGTHS_M = tuple(range(100, 900, 100))
_LOST_M, _LOST_DEG = 0.5, 5.0
"""Errors of the estimated motion since the previous turn above which a turn is lost."""
_TOLERANCE = 0.1
"""Largest relative deviation of a pair's distance from the nominal one."""
_THREADS = 1
"""With more threads, the order of sums, and thus KISS-ICP's poses, may vary."""


@TASKS.register("odometry", needs=("kiss_icp", "evo"))
def odometry(
    drive: Drive,
    decoded: Sequence[PointCloud],
    max_range_m: float = 100.0,
    voxel_m: float | None = None,
    skip: int = 5,
) -> dict[str, Any]:
    """Return KISS-ICP's drift, absolute error and number of lost turns.

    Turns with returns are corrected for the sensor's motion, to the end of the turn. Turns without
    returns are not corrected; their poses are those at the middle of the turn. `voxel_m` is by
    default a hundredth of `max_range_m`, as in KISS-ICP. The first `skip` turns, when KISS-ICP does
    not know the motion yet, do not count.
    """
    if len(decoded) < skip + 2:
        raise InputError(f"task odometry: {len(decoded)} turns, of which it skips {skip}")
    voxel_m = max_range_m / 100 if voxel_m is None else voxel_m
    estimated = estimated_poses(decoded, drive.turn_s > 0, max_range_m, voxel_m)
    settings = {
        "odometry": f"kiss-icp {version('kiss-icp')}",
        "odometry_voxel_m": voxel_m,
        "odometry_max_range_m": max_range_m,
        "odometry_threads": _THREADS,
        "odometry_skip": skip,
    }
    true = drive.poses_at(moment_of(decoded))
    return {**pose_errors(true[skip:], estimated[skip:]), **settings}


def moment_of(turns: Sequence[PointCloud]) -> float:
    """Return the time, as a fraction of a turn, at which estimated poses hold."""
    return 1.0 if all(turn.returns is not None for turn in turns) else 0.5


def estimated_poses(
    turns: Sequence[PointCloud], is_moving: bool, max_range_m: float, voxel_m: float
) -> Floats:
    """Return KISS-ICP's poses (n, 4, 4) of turns, relative to the first.

    Points are corrected for motion if turns have returns and the sensor `is_moving` during a turn.
    """
    check_installed("kiss_icp")
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.max_range, config.mapping.voxel_size = max_range_m, voxel_m
    config.registration.max_num_threads = _THREADS
    pipeline, poses, none = KissICP(config), [], np.zeros(0)
    for turn in turns:
        shares = firing_shares(turn.returns) if turn.returns and is_moving else none
        pipeline.register_frame(np.ascontiguousarray(turn.xyz), shares)
        poses.append(pipeline.last_pose)
    return np.array(poses)


def pose_errors(true: Floats, estimated: Floats) -> dict[str, Any]:
    """Return errors of estimated poses (n, 4, 4) against true ones.

    The drift over a path length is the mean error of all pairs of poses that are this length apart,
    divided by the length. ``drift_percent`` (translation) and ``drift_deg_per_m`` (rotation) are
    means over those lengths of 10, 20 and 50 m that fit into the drive. ``drift_50m_...`` is for
    one length, ``kitti_...`` for 100 to 800 m. ``ate_m`` is the RMS distance of positions after the
    best rigid alignment. A turn is lost if the motion since the last turn is wrong by more than 0.5
    m or 5 degrees.
    """
    check_installed("evo")
    from evo.core.metrics import PoseRelation, Unit

    both = _paths(true, estimated)
    steps_m = _relative_errors(both, PoseRelation.translation_part, 1, Unit.frames)
    steps_deg = _relative_errors(both, PoseRelation.rotation_angle_deg, 1, Unit.frames)
    lost = int(np.count_nonzero((steps_m > _LOST_M) | (steps_deg > _LOST_DEG)))
    whole_m = float(np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1).sum())
    absolute_m = _absolute_error(true, estimated)
    results: dict[str, Any] = {"length_m": whole_m, "lost_turns": lost, "ate_m": absolute_m}
    for name, lengths in (("drift", LENGTHS_M), ("kitti", KITTI_LENGTHS_M)):
        values = {length: drift for length in lengths if len(drift := _drift(both, length))}
        for unit, column in (("percent", 0), ("deg_per_m", 1)):
            means = {length: float(drift[column]) for length, drift in values.items()}
            if means:
                results[f"{name}_{unit}"] = float(np.mean(list(means.values())))
            results |= {f"{name}_{length}m_{unit}": value for length, value in means.items()}
    return results


def check_installed(package: str) -> None:
    """Raise InputError if a package of the extra ``odometry`` is missing."""
    if find_spec(package) is None:
        raise InputError(f"{package} is not installed: pip install 'puckbench[odometry]'")


_Paths = tuple[Any, Any]


def _paths(true: Floats, estimated: Floats) -> _Paths:
    from evo.core.trajectory import PosePath3D

    return PosePath3D(poses_se3=list(true)), PosePath3D(poses_se3=list(estimated))


def _relative_errors(both: _Paths, relation: Any, delta: float, unit: Any) -> Floats:
    from evo.core.metrics import RPE

    measure = RPE(relation, delta, unit, _TOLERANCE, all_pairs=True, pairs_from_reference=True)
    measure.process_data(both)
    return np.asarray(measure.error)


def _drift(both: _Paths, length_m: int) -> Floats:
    """Return the drift over a length in percent and degrees per metre; empty for shorter drives."""
    from evo.core.filters import FilterException
    from evo.core.metrics import PoseRelation, Unit, id_pairs_from_delta

    true, delta = both[0], float(length_m)
    try:
        pairs = id_pairs_from_delta(true.poses_se3, delta, Unit.meters, _TOLERANCE, all_pairs=True)
    except FilterException:  # no poses this far apart
        return np.zeros(0)
    apart = np.diff(true.distances[np.array(pairs)], axis=1)[:, 0]
    relations = (PoseRelation.translation_part, PoseRelation.rotation_angle_deg)
    errors = [_relative_errors(both, each, delta, Unit.meters) for each in relations]
    return np.array([100 * (errors[0] / apart).mean(), (errors[1] / apart).mean()])


def _absolute_error(true: Floats, estimated: Floats) -> float:
    from evo.core.metrics import APE, PoseRelation

    measure = APE(PoseRelation.translation_part)
    moved = _alignment(estimated[:, :3, 3], true[:, :3, 3]) @ estimated
    measure.process_data(_paths(true, moved))
    return float(np.sqrt(np.mean(np.square(measure.error))))


def _alignment(points: Floats, target: Floats) -> Floats:
    # Kabsch's method; evo's refuses straight drives, of which one angle is free.
    middle, target_middle = points.mean(axis=0), target.mean(axis=0)
    left, _, right = np.linalg.svd((points - middle).T @ (target - target_middle))
    handed = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    transform = np.eye(4)
    transform[:3, :3] = (left @ handed @ right).T
    transform[:3, 3] = target_middle - transform[:3, :3] @ middle
    return transform

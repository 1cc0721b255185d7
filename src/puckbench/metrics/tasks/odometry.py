"""Odometry on decoded turns (revolutions of the sensor), and its errors against the true poses.

Two programs estimate the poses. KISS-ICP matches points to points. Scan-to-map GICP, as in the
example `kitti_odometry.py` of small_gicp, matches distributions of points. Both assume that the
sensor moves during a turn as it did during the turn before. If the first turn is already in motion,
they need some turns to settle.

References
----------
I. Vizzo et al., "KISS-ICP: In Defense of Point-to-Point ICP", RA-L 2023.
K. Koide, "small_gicp: Efficient and parallel algorithms for point cloud registration", JOSS 2024.
A. Geiger et al., "Are we ready for Autonomous Driving?", CVPR 2012 (errors over lengths).
M. Grupp, evo, github.com/MichaelGrupp/evo.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.poses import tum_bytes
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.core.code import CLOUD_FILES
from puckbench.metrics.task_registry import TASKS
from puckbench.recordings.drives import Drive, shares_of
from puckbench.results.columns import LOWER, RUN, TASK, Column

CODE = (*CLOUD_FILES, "cloud_files.poses", "puckbench.recordings")

LENGTHS_M = (10, 20, 50)
SHORT_LENGTHS_M = (1, 2, 5)
"""Lengths of drives that are too short for `LENGTHS_M`. They count for no mean."""
KITTI_LENGTHS_M = tuple(range(100, 900, 100))
GICP = "gicp_"
"""Prefix of the columns of GICP. Columns of KISS-ICP have no prefix."""
_LOST_SHARE = 0.5
_LOST_M, _LOST_DEG = (0.05, 0.5), (1.0, 5.0)
"""Bounds, in m and degrees, of the error above which a turn is lost. Between them, the limit is
half of the true motion."""
_JUDGED_M = 0.1
"""Mean motion, in m, over which the estimate of a slow sensor may not stand still: half of it is
the least error of a lost turn."""
_LENGTHS_IN_A_PATH = 2
"""Fewest times that a length must fit into the path for a drift over it."""
_TOLERANCE = 0.1
"""Largest relative deviation of a pair's distance from the nominal one."""
_THREADS = 1
"""With more threads, the order of sums, and thus the poses, may vary."""
_SKIP = 15
_FINER = 4
"""Voxels of GICP's map in a row over those of a turn (1 m and 0.25 m in small_gicp's example)."""
_NEIGHBOURS = 10
_SHORT = "the drive is too short"
_UNITS = ("percent", "deg_per_m")


def _columns(errors: str, settings: str, method: str = "") -> Iterator[Column]:
    """Yield the columns of errors and settings, with prefixes of names and the method in words."""

    def error(name: str, words: str, unit: str = "", **more: Any) -> Column:
        return Column(errors + name, words + method, unit, LOWER, TASK, **more)

    is_shown = not errors
    yield error("ate_m", "Absolute error of positions", "m", summarised=is_shown)
    yield error("lost_turns", "Lost turns", summarised=is_shown)
    yield error("drift_percent", "Drift", "%", missing=_SHORT, summarised=is_shown)
    yield error("drift_deg_per_m", "Drift of rotation", "°/m", missing=_SHORT)
    yield error("kitti_percent", "Drift over 100 to 800 m", "%", missing=_SHORT)
    yield error("kitti_deg_per_m", "Drift of rotation over 100 to 800 m", "°/m", missing=_SHORT)
    names = [(f"drift_{length}m", length) for length in (*SHORT_LENGTHS_M, *LENGTHS_M)]
    names += [(f"kitti_{length}m", length) for length in KITTI_LENGTHS_M]
    for name, length in names:
        is_short = is_shown and length in SHORT_LENGTHS_M
        text = f"Drift over {length} m"
        yield error(f"{name}_percent", text, "%", missing=_SHORT, summarised=is_short)
        text = f"Drift of rotation over {length} m"
        yield error(f"{name}_deg_per_m", text, "°/m", missing=_SHORT)
    for name, words, unit in (
        ("voxel_m", "Voxel of the map", "m"),
        ("max_range_m", "Largest range used", "m"),
        ("skip", "Turns skipped at the start", ""),
        ("threads", "Threads of odometry", ""),
    ):
        yield Column(settings + name, words + method, unit, group=RUN)


@TASKS.register("odometry", needs=("kiss_icp", "evo"), columns=_columns("", "odometry_"))
def odometry(
    drive: Drive,
    decoded: Sequence[PointCloud],
    max_range_m: float = 100.0,
    voxel_m: float | None = None,
    skip: int | None = None,
) -> dict[str, Any]:
    """Run KISS-ICP on decoded turns, and return its errors against the true poses.

    If the points of all turns have times, points are corrected for the sensor's motion and poses
    hold at the end of a turn. Otherwise poses are compared with the true ones at the middle of a
    turn.

    Parameters
    ----------
    drive
        The drive that was encoded, with the true poses.
    decoded
        The decoded cloud of each turn, in sensor coordinates, in m.
    max_range_m
        Largest distance, in m, of points that are used.
    voxel_m
        Side of the voxels of KISS-ICP's map, in m; by default a hundredth of `max_range_m`.
    skip
        Number of turns at the start that do not count, since KISS-ICP has to settle; by default 15,
        but not more than half of the turns.

    Returns
    -------
    dict
        The values of `pose_errors`, the settings (``odometry_...``), and the version of KISS-ICP;
        and as ``kiss_icp.tum`` the content of a file with the estimated poses. They hold at the
        moments of the true poses, and begin with the first of these.

    Raises
    ------
    InputError
        There are too few turns, or a required package is not installed.
    """
    skip = _turns_to_skip("odometry", decoded, skip)
    max_range_m, voxel_m = settings_of(max_range_m, voxel_m)
    estimated = estimated_poses(decoded, drive.turn_s > 0, max_range_m, voxel_m)
    settings = {
        "odometry": f"kiss-icp {version('kiss-icp')}",
        "odometry_voxel_m": voxel_m,
        "odometry_max_range_m": max_range_m,
        "odometry_threads": _THREADS,
        "odometry_skip": skip,
    }
    true = drive.poses_at(moment_of(decoded))
    trajectory = {"kiss_icp.tum": _tum(drive, decoded, true, estimated)}
    return {**pose_errors(true[skip:], estimated[skip:]), **settings, **trajectory}


_OF_GICP = (
    *_columns(GICP, GICP, ", GICP"),
    Column("gicp", "Version of GICP", group=RUN),
    Column("gicp_length_m", "Length of the drive, GICP", "m", group=RUN),
)


@TASKS.register("gicp_odometry", needs=("small_gicp", "evo"), columns=_OF_GICP)
def gicp_odometry(
    drive: Drive,
    decoded: Sequence[PointCloud],
    max_range_m: float = 100.0,
    voxel_m: float | None = None,
    skip: int | None = None,
) -> dict[str, Any]:
    """Run scan-to-map GICP on decoded turns, and return its errors against the true poses.

    Parameters and results are those of `odometry`, but the names of results begin with ``gicp_``,
    and the file of poses is ``gicp.tum``. GICP keeps a normal distribution of points in
    each voxel of the map. The voxels of a single turn are a fourth as large, and points are matched
    at most `voxel_m` apart.
    """
    skip = _turns_to_skip("gicp_odometry", decoded, skip)
    max_range_m, voxel_m = settings_of(max_range_m, voxel_m)
    estimated = gicp_poses(decoded, drive.turn_s > 0, max_range_m, voxel_m)
    true = drive.poses_at(moment_of(decoded))
    errors = pose_errors(true[skip:], estimated[skip:])
    length = errors.pop("length_m")
    settings = {"voxel_m": voxel_m, "max_range_m": max_range_m, "skip": skip, "length_m": length}
    named = {f"{GICP}{name}": value for name, value in {**errors, **settings}.items()}
    trajectory = {"gicp.tum": _tum(drive, decoded, true, estimated)}
    return {**named, "gicp": f"small_gicp {version('small_gicp')}", **trajectory}


def settings_of(
    max_range_m: float = 100.0, voxel_m: float | None = None, skip: int | None = None
) -> tuple[float, float]:
    """Return the largest range and the voxel size, both in m, that a task's options select."""
    return max_range_m, max_range_m / 100 if voxel_m is None else voxel_m


def moment_of(turns: Sequence[PointCloud]) -> float:
    """Return the time in a turn for which poses are estimated: 1 is the end, 0.5 the middle.

    It is the end if the points of all turns have times.
    """
    return 1.0 if all(shares_of(turn) is not None for turn in turns) else 0.5


def estimated_poses(
    turns: Sequence[PointCloud], is_moving: bool, max_range_m: float, voxel_m: float
) -> Floats:
    """Estimate the sensor's poses by KISS-ICP.

    Parameters
    ----------
    turns
        Clouds of the turns, in sensor coordinates, in m.
    is_moving
        Whether the sensor moves during a turn. If so, points with times are corrected for the
        motion.
    max_range_m, voxel_m
        Largest distance of used points, and side of the map's voxels, in m.

    Returns
    -------
    numpy.ndarray
        Poses (n, 4, 4) relative to the first turn.
    """
    check_installed("kiss_icp")
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.max_range, config.mapping.voxel_size = max_range_m, voxel_m
    config.registration.max_num_threads = _THREADS
    pipeline, poses, none = KissICP(config), [], np.zeros(0)
    for turn in turns:
        shares = shares_of(turn) if is_moving else None
        pipeline.register_frame(np.ascontiguousarray(turn.xyz), none if shares is None else shares)
        poses.append(pipeline.last_pose)
    return np.array(poses)


def gicp_poses(
    turns: Sequence[PointCloud], is_moving: bool, max_range_m: float, voxel_m: float
) -> Floats:
    """Estimate the sensor's poses by scan-to-map GICP.

    Parameters and result are those of `estimated_poses`.
    """
    check_installed("small_gicp")
    from small_gicp import GaussianVoxelMap, align, preprocess_points

    surroundings = GaussianVoxelMap(voxel_m)
    surroundings.set_lru(horizon=100, clear_cycle=10)
    pose, motion = np.eye(4), np.eye(4)
    poses: list[Floats] = []
    for turn in turns:
        near = np.linalg.norm(turn.xyz, axis=1) <= max_range_m
        points, shares = turn.xyz[near], shares_of(turn) if is_moving else None
        if shares is not None:
            points = at_end_of_turn(points, shares[near], motion)
        source, _ = preprocess_points(points, voxel_m / _FINER, _NEIGHBOURS, _THREADS)
        if poses:
            found = align(
                surroundings,
                source,
                pose @ motion,
                max_correspondence_distance=voxel_m,
                num_threads=_THREADS,
            ).T_target_source
            pose, motion = found, np.linalg.inv(pose) @ found
        surroundings.insert(source, pose)
        poses.append(pose)
    return np.array(poses)


def at_end_of_turn(points: Floats, shares: Floats, motion: Floats) -> Floats:
    """Convert points of a moving sensor to the sensor's coordinates at the end of the turn.

    Parameters
    ----------
    points
        Points (n, 3) in m, each in the sensor's coordinates at the time of its measurement.
    shares
        Times (n,) of the points, from 0 (start of the turn) to 1 (end of the turn).
    motion
        Motion (4, 4) of the sensor during the turn, with constant velocity and angular velocity.

    Returns
    -------
    numpy.ndarray
        The converted points (n, 3).
    """
    from scipy.spatial.transform import Rotation

    axis = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    angle = float(np.linalg.norm(axis))
    back = shares - 1
    turned = Rotation.from_rotvec(back[:, None] * axis).apply(points)
    if angle < 1e-9:
        return np.asarray(turned + back[:, None] * motion[:3, 3])
    cross = np.cross(np.eye(3), axis / angle)  # the matrix of the cross product with the axis

    def moved(share: Floats) -> Floats:  # integral of the rotation from 0 to each share
        sine, cosine = np.sin(share * angle) / angle, (1 - np.cos(share * angle)) / angle
        parts = (share, np.eye(3)), (cosine, cross), (share - sine, cross @ cross)
        return np.asarray(sum(part[:, None, None] * matrix for part, matrix in parts))

    velocity = np.linalg.solve(moved(np.ones(1))[0], motion[:3, 3])
    return np.asarray(turned + moved(back) @ velocity)


def _turns_to_skip(task: str, decoded: Sequence[PointCloud], skip: int | None) -> int:
    turns = len(decoded)
    if skip is None:
        return min(_SKIP, turns // 2 if turns > 2 else 0)
    if turns < skip + 2:
        raise InputError(f"task {task}: {turns} turns, of which it skips {skip}")
    return skip


def _tum(drive: Drive, decoded: Sequence[PointCloud], true: Floats, estimated: Floats) -> bytes:
    times = drive.starts + moment_of(decoded) * drive.turn_s
    return tum_bytes(times, true[0] @ np.linalg.inv(estimated[0]) @ estimated)


def pose_errors(true: Floats, estimated: Floats) -> dict[str, Any]:
    """Return the errors of estimated poses against the true ones.

    The drift over a path length is the mean error of all pairs of poses that are this length apart,
    divided by the length. A turn is lost if the motion since the turn before is wrong by more than
    half of the true motion. Errors below 0.05 m and 1 degree never count as lost, errors above 0.5
    m or 5 degrees always do. If the sensor moves by less than 0.1 m a turn in the mean, a turn is
    lost, too, if the estimate moved less than half as far as the sensor did over so many turns that
    this moves by 0.1 m in the mean.

    Parameters
    ----------
    true, estimated
        Poses (n, 4, 4), translations in m.

    Returns
    -------
    dict
        * ``length_m``: length of the true path.
        * ``lost_turns``: number of lost turns.
        * ``ate_m``: RMS distance of positions after the best rigid alignment.
        * ``drift_percent``, ``drift_deg_per_m``: drift of translation and rotation, mean over those
          of the lengths 10, 20 and 50 m that fit twice into the path.
        * ``kitti_percent``, ``kitti_deg_per_m``: the same over the lengths 100 to 800 m that occur.
        * ``drift_50m_percent`` and similar names: the drift over a single length. Paths that are
          too short for 10 m have drifts over those of 1, 2 and 5 m that fit twice.
    """
    check_installed("evo")
    from evo.core.metrics import PoseRelation, Unit

    both = _paths(true, estimated)
    steps_m = _relative_errors(both, PoseRelation.translation_part, 1, Unit.frames)
    steps_deg = _relative_errors(both, PoseRelation.rotation_angle_deg, 1, Unit.frames)
    moved_m = np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1)
    lost_m = np.clip(_LOST_SHARE * moved_m, *_LOST_M)
    lost_deg = np.clip(_LOST_SHARE * _turned_deg(true), *_LOST_DEG)
    is_lost = (steps_m > lost_m) | (steps_deg > lost_deg) | _stands_still(true, estimated)
    lost = int(np.count_nonzero(is_lost))
    whole_m = float(moved_m.sum())
    absolute_m = _absolute_error(true, estimated)
    results: dict[str, Any] = {"length_m": whole_m, "lost_turns": lost, "ate_m": absolute_m}
    fitting = [each for each in LENGTHS_M if _LENGTHS_IN_A_PATH * each <= whole_m]
    if not fitting:
        short = (each for each in SHORT_LENGTHS_M if _LENGTHS_IN_A_PATH * each <= whole_m)
        results |= _named_drifts("drift", _drifts(both, short))
    for name, lengths in (("drift", fitting), ("kitti", KITTI_LENGTHS_M)):
        drifts = _drifts(both, lengths)
        for column, unit in enumerate(_UNITS if drifts else ()):
            results[f"{name}_{unit}"] = float(np.mean([each[column] for each in drifts.values()]))
        results |= _named_drifts(name, drifts)
    return results


def _drifts(both: _Paths, lengths: Iterable[int]) -> dict[int, Floats]:
    return {length: drift for length in lengths if len(drift := _drift(both, length))}


def _named_drifts(name: str, drifts: Mapping[int, Floats]) -> dict[str, float]:
    return {
        f"{name}_{length}m_{unit}": float(value)
        for length, drift in drifts.items()
        for unit, value in zip(_UNITS, drift, strict=True)
    }


def _stands_still(true: Floats, estimated: Floats) -> NDArray[np.bool_]:
    """Return whether the estimate hardly moved while a slow sensor moved on, by turn (n - 1,)."""
    mean_m = float(np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1).mean())
    still = np.zeros(len(true) - 1, np.bool_)
    turns = min(math.ceil(_JUDGED_M / max(mean_m, 1e-9)), len(true) - 1)
    if turns > 1:
        moved_m, estimated_m = (
            np.linalg.norm(poses[turns:, :3, 3] - poses[:-turns, :3, 3], axis=1)
            for poses in (true, estimated)
        )
        has_moved = moved_m > _LOST_M[0]
        still[turns - 1 :] = has_moved & (estimated_m < _LOST_SHARE * moved_m)
    return still


def _turned_deg(poses: Floats) -> Floats:
    from scipy.spatial.transform import Rotation

    turned = poses[:-1, :3, :3].transpose(0, 2, 1) @ poses[1:, :3, :3]
    return np.degrees(Rotation.from_matrix(turned).magnitude())


def check_installed(package: str) -> None:
    """Raise InputError if a Python package that odometry needs is not installed."""
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
    """Return the drift in percent and degrees per metre (2,); empty if the drive is too short."""
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

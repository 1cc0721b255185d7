"""Registration of pairs of decoded turns by KISS-Matcher, from unknown poses.

References
----------
H. Lim et al., "KISS-Matcher: Fast and Robust Point Cloud Registration Revisited", ICRA 2025.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from typing import Any

import numpy as np

from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.seeding import generator
from puckbench.metrics.task_measures import TaskMeasure
from puckbench.metrics.task_registry import TASKS
from puckbench.metrics.tasks.odometry import check_installed
from puckbench.metrics.tasks.registration import motion_errors, pairs_apart, successes
from puckbench.recordings.drives import Drive
from puckbench.results.columns import HIGHER, LOWER, RUN, TASK, Column

CODE = ("puckbench.metrics.tasks.odometry", "puckbench.metrics.tasks.registration")

_APART_M = (2, 5, 10)
_MOVED_M = 10.0
"""Largest coordinate, in m, of the unknown translation of a turn."""
_NORMAL_RADIUS, _LEAST_NEIGHBOURS = 3.0, 6
"""Radius, in voxels, within which KISS-Matcher estimates normals, and how many points there have to
be, with the point itself."""
_LEAST_POINTS = 30
"""Number of points with a normal below which no turn can be registered."""
_NAME = "global_registration"


def _columns() -> Iterator[Column]:
    for apart in _APART_M:
        name, pairs = f"{_NAME}_{apart}m", f"of pairs {apart} m apart"
        text = f"Registered from unknown poses, {pairs}"
        yield Column(f"{name}_percent", text, "%", HIGHER, TASK, missing="the drive is too short")
        text = f"Error of the registrations from unknown poses, {pairs}"
        yield Column(f"{name}_error_m", text, "m", LOWER, TASK, missing="none succeeded")
    yield Column(_NAME, "Version of the global registration", group=RUN)
    yield Column(f"{_NAME}_voxel_m", "Voxel of the global registration", "m", group=RUN)
    text = "Largest error of a global registration"
    yield Column(f"{_NAME}_most_m", text, "m", group=RUN)
    yield Column(f"{_NAME}_most_deg", text, "°", group=RUN)


_MEASURES = [
    TaskMeasure(
        name=_NAME,
        title="Registration from unknown poses, 5 m apart",
        column=f"{_NAME}_5m_percent",
        unit="%",
        better=HIGHER,
        margin=5.0,
    )
]


@TASKS.register(_NAME, needs=("kiss_matcher", "evo"), columns=_columns(), measures=_MEASURES)
def global_registration(
    drive: Drive,
    decoded: Sequence[PointCloud],
    pairs: int = 4,
    voxel_m: float = 0.3,
    most_m: float = 2.0,
    most_deg: float = 5.0,
    seed: int = 0,
) -> dict[str, Any]:
    """Register pairs of decoded turns whose poses are unknown, and return how often it succeeds.

    Pairs are 2, 5 and 10 m apart. The later turn of each pair is first rotated and moved at random,
    about any axis and by up to 10 m along each axis: the same way for every codec and rate.
    KISS-Matcher has to find the motion from the points alone; points are not corrected for the
    sensor's motion within a turn. A registration succeeds if it differs from the true motion by at
    most `most_m` and `most_deg`. The defaults of both are those of the authors. KISS-Matcher runs
    on one processor, since the order of its results depends on the threads; only on Linux are these
    the same every time.

    Parameters
    ----------
    drive
        The drive that was encoded, with the true poses.
    decoded
        The decoded cloud of each turn, in sensor coordinates, in m.
    pairs
        Largest number of pairs for each distance.
    voxel_m
        Side of the voxels, in m, to which clouds are downsampled.
    most_m, most_deg
        Largest errors of a success, in m and degrees.
    seed
        Seed of the random motions.

    Returns
    -------
    dict
        For each distance that the drive has, such as 5 m: ``global_registration_5m_percent``, the
        success rate, and ``global_registration_5m_error_m``, the median translation error of
        successes. The settings and the version of KISS-Matcher are added.

    Raises
    ------
    InputError
        A required package is not installed.
    """
    check_installed("evo")
    check_installed("kiss_matcher")

    true = drive.poses_at(0.5)
    results: dict[str, Any] = {}
    for apart in _APART_M:
        errors = []
        for i, j in pairs_apart(true, apart, pairs):
            unknown = _random_motion(generator(seed, _NAME, str(i), str(j)))
            moved = decoded[j].xyz @ unknown[:3, :3].T + unknown[:3, 3]
            found = _motion(moved, decoded[i].xyz, voxel_m) @ unknown
            errors.append(motion_errors(np.linalg.inv(true[i]) @ true[j], found))
        if errors:
            results |= successes(f"{_NAME}_{apart}m", np.array(errors), most_m, most_deg)
    name = f"kiss-matcher {version('kiss-matcher')}"
    settings = {"voxel_m": voxel_m, "most_m": most_m, "most_deg": most_deg}
    return {
        **results,
        _NAME: name,
        **{f"{_NAME}_{key}": value for key, value in settings.items()},
    }


def _random_motion(rng: np.random.Generator) -> Floats:
    from scipy.spatial.transform import Rotation

    motion = np.eye(4)
    motion[:3, :3] = Rotation.random(rng=rng).as_matrix()
    motion[:3, 3] = rng.uniform(-_MOVED_M, _MOVED_M, 3)
    return motion


def _motion(source: Floats, target: Floats, voxel_m: float) -> Floats:
    """Return the motion (4, 4) of source points to the target; the identity if none was found."""
    from kiss_matcher import KISSMatcher, KISSMatcherConfig

    motion = np.eye(4)
    if all(_has_features(points, voxel_m) for points in (source, target)):
        matcher = KISSMatcher(KISSMatcherConfig(voxel_size=voxel_m))
        with _on_one_processor():
            found = matcher.estimate(*(points.astype(np.float32) for points in (source, target)))
        if found.valid:
            motion[:3, :3], motion[:3, 3] = found.rotation, found.translation
    return motion


@contextmanager
def _on_one_processor() -> Iterator[None]:
    """Keep this thread, and the threads that it starts, on one processor where Linux allows it."""
    if sys.platform != "linux":
        yield
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {sorted(allowed)[os.getpid() % len(allowed)]})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


def _has_features(points: Floats, voxel_m: float) -> bool:
    """Return whether enough voxels have neighbours; KISS-Matcher crashes if none has."""
    from scipy.spatial import KDTree

    voxels = np.unique(np.floor(points / voxel_m), axis=0)
    radius = _NORMAL_RADIUS
    counts = KDTree(voxels).query_ball_point(voxels, radius, return_length=True)
    return bool(np.count_nonzero(counts >= _LEAST_NEIGHBOURS) >= _LEAST_POINTS)

"""Registration of pairs of decoded turns by GICP.

References
----------
K. Koide, "small_gicp: Efficient and parallel algorithms for point cloud registration", JOSS 2024.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.metrics.task_registry import TASKS
from puckbench.metrics.tasks.odometry import check_installed
from puckbench.recordings.drives import Drive
from puckbench.results.columns import HIGHER, LOWER, RUN, TASK, Column

CODE = ("puckbench.metrics.tasks.odometry",)

_APART_M = (1, 2, 5)
_TOLERANCE = 0.3
"""Largest relative deviation of a pair's distance from the nominal one."""


def _columns() -> Iterator[Column]:
    for apart in _APART_M:
        name, pairs = f"registration_{apart}m", f"of pairs {apart} m apart"
        yield Column(f"{name}_percent", f"Registered {pairs}", "%", HIGHER, TASK)
        text = f"Error of the registrations {pairs}"
        yield Column(f"{name}_error_m", text, "m", LOWER, TASK, missing="none succeeded")
    yield Column("registration", "Version of the registration", group=RUN)
    yield Column("registration_voxel_m", "Voxel of the registration", "m", group=RUN)
    yield Column("registration_reach_m", "Largest distance of matches", "m", group=RUN)
    yield Column("registration_most_m", "Largest error of a registration", "m", group=RUN)
    yield Column("registration_most_deg", "Largest error of a registration", "°", group=RUN)


@TASKS.register("registration", needs=("small_gicp", "evo"), columns=_columns())
def registration(
    drive: Drive,
    decoded: Sequence[PointCloud],
    pairs: int = 8,
    voxel_m: float = 0.25,
    reach_m: float = 5.0,
    most_m: float = 0.3,
    most_deg: float = 2.0,
) -> dict[str, Any]:
    """Register pairs of decoded turns by GICP, and return how often it succeeds.

    Pairs are 1, 2 and 5 m apart. GICP has no initial guess, and points are not corrected for the
    sensor's motion within a turn. A registration succeeds if it differs from the true motion
    between the middles of both turns by at most `most_m` and `most_deg`.

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
    reach_m
        Largest distance, in m, of two points that are matched.
    most_m, most_deg
        Largest errors of a success, in m and degrees.

    Returns
    -------
    dict
        For each distance, such as 5 m: ``registration_5m_percent``, the success rate, and
        ``registration_5m_error_m``, the median translation error of successes. The settings and the
        version of small_gicp are added.
    """
    check_installed("evo")
    check_installed("small_gicp")

    true = drive.poses_at(0.5)
    results: dict[str, Any] = {}
    settings = {"downsampling_resolution": voxel_m, "max_correspondence_distance": reach_m}
    for apart in _APART_M:
        chosen = pairs_apart(true, apart, pairs)
        if not chosen:
            continue
        errors = np.array(
            [
                _errors(
                    decoded[i].xyz, decoded[j].xyz, np.linalg.inv(true[i]) @ true[j], **settings
                )
                for i, j in chosen
            ]
        )
        results |= successes(f"registration_{apart}m", errors, most_m, most_deg)
    name = f"small_gicp {version('small_gicp')}"
    limits = {"registration_most_m": most_m, "registration_most_deg": most_deg}
    sizes = {"registration_voxel_m": voxel_m, "registration_reach_m": reach_m}
    return {**results, "registration": name, **sizes, **limits}


def pairs_apart(poses: Floats, apart_m: float, most: int) -> list[tuple[int, int]]:
    """Return pairs of poses that are a given length of the way apart, evenly over a drive.

    Parameters
    ----------
    poses
        Poses (n, 4, 4), translations in m.
    apart_m
        Length of the way between the poses of a pair, in m; it may deviate by 30 %.
    most
        Largest number of pairs.

    Returns
    -------
    list
        Numbers of the poses of each pair, the earlier one first; empty if the way is too short.
    """
    from evo.core.filters import filter_pairs_by_path

    every = filter_pairs_by_path(list(poses), apart_m, apart_m * _TOLERANCE, all_pairs=True)
    places = np.linspace(0, len(every) - 1, min(most, len(every))).round().astype(int)
    return [(int(every[place][0]), int(every[place][1])) for place in places]


def motion_errors(true: Floats, estimated: Floats) -> tuple[float, float]:
    """Return by how much an estimated motion (4, 4) differs from the true one, in m and degrees."""
    off = np.linalg.inv(true) @ estimated
    cosine = np.clip((np.trace(off[:3, :3]) - 1) / 2, -1, 1)
    return float(np.linalg.norm(off[:3, 3])), float(np.degrees(np.arccos(cosine)))


def successes(name: str, errors: Floats, most_m: float, most_deg: float) -> dict[str, float]:
    """Return the success rate of registrations, and the median error of those that succeeded.

    Parameters
    ----------
    name
        Beginning of the names of the results.
    errors
        Errors of the translation, in m, and of the rotation, in degrees, (n, 2).
    most_m, most_deg
        Largest errors of a success.

    Returns
    -------
    dict
        ``NAME_percent``, and ``NAME_error_m`` if a registration succeeded.
    """
    good = (errors[:, 0] <= most_m) & (errors[:, 1] <= most_deg)
    results = {f"{name}_percent": 100 * float(good.mean())}
    if good.any():
        results[f"{name}_error_m"] = float(np.median(errors[good, 0]))
    return results


def _errors(
    first: Floats, second: Floats, motion: Floats, **settings: float
) -> tuple[float, float]:
    from small_gicp import align

    return motion_errors(motion, align(first, second, **settings).T_target_source)

"""Whether the axes of given poses are those of the turns, found from the points of the turns.

Poses of ROS have x forward and y left, while the turns of packets have x right and y forward. With
the right axes, the walls in one turn lie on those in another when the poses bring them together.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from itertools import chain
from typing import NamedTuple

import numpy as np

from pointkit.geometry.cloud import Floats

_log = logging.getLogger(__name__)

_APART_M, _LEAST_APART_M = 2.0, 0.5
"""Motion between the two turns of a pair, in m: the preferred one and the least."""
_STARTS, _MOST_LATER = 500, 100
"""Number of turns that are tried as the first of a pair, and by how many turns the second may be
later."""
_PAIRS, _WALL_POINTS, _MAP_POINTS = 6, 1500, 12_000
_NEAR_M, _FAR_M = 1.5, 40.0
"""Horizontal distances, in m, between which points tell something."""
_ABOVE_GROUND_M, _GROUND_SHARE = 0.4, 0.05
_STEP_DEG = 5
_LIKE_DEG, _UNLIKE_DEG = 10, 45
"""Largest angle, in degrees, between axes that count as the same, and least between others."""
_CLEAR = 0.7
"""Largest distance between walls, as a share of the least one with other axes, that is clear."""


class AxesOfPoses(NamedTuple):
    """How the axes of poses lie to those of the turns.

    Parameters
    ----------
    turned_deg
        Angle, in degrees, of the turn about z that takes the axes of the poses to those of the
        turns, if the turns show it: 0, 90, 180, -90, or another angle, which no convention has.
        None if the turns do not show it.
    is_known
        Whether the sensor moves, so that the turns could show the axes.
    """

    turned_deg: float | None
    is_known: bool = True


def walls_of(xyz: Floats) -> Floats:
    """Return points of a turn that stand above the ground, and not too near or too far.

    Parameters
    ----------
    xyz
        Points of the turn, (n, 3), in m, z up.

    Returns
    -------
    array
        At most 12,000 of the points, evenly chosen, (m, 3).
    """
    level = np.hypot(xyz[:, 0], xyz[:, 1])
    ground = np.quantile(xyz[:, 2], _GROUND_SHARE) if len(xyz) else 0.0
    is_wall = (level > _NEAR_M) & (level < _FAR_M) & (xyz[:, 2] > ground + _ABOVE_GROUND_M)
    return _thinned(xyz[is_wall], _MAP_POINTS)


def _thinned(points: Floats, most: int) -> Floats:
    return points[:: max(-(-len(points) // most), 1)]


def pairs_apart(poses: Floats) -> list[tuple[int, int]]:
    """Return pairs of turns between which the sensor moved about 2 m, or what it moved at most.

    Parameters
    ----------
    poses
        Poses of the turns, (n, 4, 4), in m.

    Returns
    -------
    list
        At most six pairs (earlier, later), evenly spread; none if the sensor moved less than 0.5 m.
    """
    places = poses[:, :3, 3]
    pairs = []
    for first in range(0, len(places) - 1, max(len(places) // _STARTS, 1)):
        later = places[first + 1 : first + 1 + _MOST_LATER]
        moved = np.linalg.norm(later - places[first], axis=1)
        far = np.flatnonzero(moved >= _APART_M)
        second = int(far[0]) if len(far) else int(np.argmax(moved))
        if moved[second] >= _LEAST_APART_M:
            pairs.append((first, first + 1 + second))
    numbers = np.linspace(0, max(len(pairs) - 1, 0), _PAIRS).astype(int)
    return [pairs[number] for number in np.unique(numbers) if pairs]


def axes_of_poses(
    poses: Floats, walls: Mapping[int, Floats], pairs: list[tuple[int, int]]
) -> AxesOfPoses:
    """Find how the axes of poses lie to those of turns.

    Parameters
    ----------
    poses
        Poses of the turns, (n, 4, 4), in m.
    walls
        What `walls_of` returns of each turn in `pairs`, by number of the turn.
    pairs
        What `pairs_apart` returns.
    """
    usable = [pair for pair in pairs if all(len(walls[number]) for number in pair)]
    if not usable:
        return AxesOfPoses(None, is_known=False)
    degrees = np.arange(-180 + _STEP_DEG, 181, _STEP_DEG)
    turns = np.array([turned_about_z(float(angle)) for angle in degrees])
    apart = np.sum([_walls_apart(poses, walls, pair, turns) for pair in usable], axis=0)
    best = int(np.argmin(apart))
    is_other = np.abs((degrees - degrees[best] + 180) % 360 - 180) >= _UNLIKE_DEG
    if apart[best] > _CLEAR * apart[is_other].min():
        return AxesOfPoses(None)
    angle = float(degrees[best])
    right = 90.0 * round(angle / 90)
    return AxesOfPoses(right if abs(angle - right) <= _LIKE_DEG else angle)


def turned_about_z(degrees: float) -> Floats:
    """Return the matrix (4, 4) of a turn about z, counter-clockwise seen from above."""
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    turned = np.eye(4)
    turned[:2, :2] = [[cosine, -sine], [sine, cosine]]
    return turned


def _walls_apart(
    poses: Floats, walls: Mapping[int, Floats], pair: tuple[int, int], turns: Floats
) -> Floats:
    """Return the mean distance of two turns' walls, seen from above, for each turn of the axes."""
    from scipy.spatial import cKDTree

    first, second = pair
    motion = np.linalg.inv(poses[first]) @ poses[second]
    most_m = float(np.linalg.norm(motion[:3, 3])) / 2
    tree = cKDTree(walls[first][:, :2])
    points = _thinned(walls[second], _WALL_POINTS)
    moved = np.linalg.inv(turns) @ motion @ turns
    places = np.einsum("kij,nj->kni", moved[:, :2, :3], points) + moved[:, None, :2, 3]
    distances, _ = tree.query(places, distance_upper_bound=most_m)
    return np.asarray(np.minimum(distances, most_m).mean(axis=1) / most_m)


def axes_from_turns(
    label: str, poses: Floats, points_of: Callable[[int], Floats]
) -> tuple[Floats, str]:
    """Return what `in_axes_of_turns` does, from the points of turns.

    `points_of` returns the points (n, 3), in m, of the turn with a number. Only the few turns that
    are compared are asked for.
    """
    pairs = pairs_apart(poses)
    walls = {number: walls_of(points_of(number)) for number in {*chain(*pairs)}}
    return in_axes_of_turns(label, poses, walls, pairs)


def in_axes_of_turns(
    label: str, poses: Floats, walls: Mapping[int, Floats], pairs: list[tuple[int, int]]
) -> tuple[Floats, str]:
    """Return how to take poses to the axes of the turns, and tell what was found in a warning.

    Parameters
    ----------
    label
        Text with which the warning begins, such as the name of the file of poses.
    poses, walls, pairs
        As for `axes_of_poses`.

    Returns
    -------
    matrix
        Matrix (4, 4) by which poses are to be multiplied from the right. It is a turn about z by a
        multiple of 90 degrees; for other angles, and if the turns show none, it turns nothing.
    remark
        What the warning says, in few words; empty without a warning.
    """
    found = axes_of_poses(poses, walls, pairs)
    if not found.is_known or found.turned_deg == 0:
        return np.eye(4), ""
    angle, matrix = found.turned_deg, np.eye(4)
    if angle is None:
        remark = "the turns do not show whether its axes are theirs"
    elif angle % 90:
        remark = f"its axes are about {angle:g} degrees about z off those of the turns, and kept"
    else:
        of_ros = "ROS's axes (x forward)" if angle == -90 else "other axes"
        remark = f"converted from {of_ros}, by {angle:g} degrees about z"
        matrix = turned_about_z(angle)
    _log.warning("%s: %s", label, remark)
    return matrix, remark

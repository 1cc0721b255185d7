"""Small clouds and returns of which checks make codecs code; each call returns the same."""

from __future__ import annotations

import math

import numpy as np

from pointkit.geometry.cloud import Floats
from pointkit.lidar.returns import Returns

SIDE = 1024
"""Side of the cube of the clouds, in grid steps."""
UNITS_PER_METRE = 128.0
"""Grid steps of a metre in clouds in metres, which are rooms of 8 m."""


def surface(points: int = 4000) -> Floats:
    """Return points (n, 3) on a sphere and a plane, as on surfaces that a sensor sees."""
    random = np.random.default_rng(5)
    ball = random.normal(size=(points // 2, 3))
    ball = 500 + 400 * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    plane = np.column_stack([random.random((points // 2, 2)) * 1023, np.full(points // 2, 100.0)])
    return np.vstack([ball, plane])


def dense_surface() -> Floats:
    """Return neighbouring voxels (n, 3) of a sphere, which a neural network can code."""
    points = np.random.default_rng(5).normal(size=(6000, 3))
    points *= 20 / np.linalg.norm(points, axis=1, keepdims=True)
    voxels: Floats = np.unique(np.rint(32 + points), axis=0)
    return voxels


def random_points(count: int = 400) -> Floats:
    """Return distinct points (count, 3) at random in a cube of side `SIDE`, on its grid."""
    numbers = np.random.default_rng(7).choice(SIDE**3, count, replace=False)
    return np.column_stack(np.unravel_index(numbers, (SIDE,) * 3)).astype(float)


def least_bits(points: int, decoded: int, errors: Floats) -> float:
    """Return how many bits a stream of `random_points` must have, at the least.

    A decoded cloud is right for all sets of points that lie within an error of it. If few of the
    sets are, a stream must select one of many decoded clouds, and needs as many bits.

    Parameters
    ----------
    points
        Number of random points.
    decoded
        Number of distinct decoded points.
    errors
        Distance of each random point from the nearest decoded one, (points,), grid steps.

    Returns
    -------
    float
        The number of bits, less 64. A stream that has less than that exists for one cloud in 2^64.
    """
    needed = 0.0
    for share in (0.5, 0.9, 1.0):
        near = math.ceil(share * points)
        reach = float(np.partition(errors, near - 1)[near - 1])
        around = 4 / 3 * math.pi * (reach + 3**0.5 / 2) ** 3
        covered = min(decoded * around, float(SIDE**3))
        others = points - near
        bits = _log2_choices(SIDE**3, points) - _log2_choices(SIDE**3, others)
        needed = max(needed, bits - _log2_choices(covered, near))
    return needed - 64


def _log2_choices(of: float, count: int) -> float:
    """Return the binary logarithm of the number of sets of `count` out of `of` things."""
    of = max(of, float(count))
    parts = math.lgamma(of + 1) - math.lgamma(count + 1) - math.lgamma(of - count + 1)
    return parts / math.log(2)


def room_returns(packets: int = 12) -> Returns:
    """Return the returns of a VLP-16 in a room, in whole data packets."""
    from pointkit.lidar.turns import Turn
    from puck.recordings.packet_turns import packet_kind
    from puck.recordings.packets import STRONGEST_MODE, VLP16

    kind, random = packet_kind(VLP16, STRONGEST_MODE), np.random.default_rng(11)
    blocks = packets * kind.layout.blocks_per_time
    columns = blocks * kind.layout.columns_per_block
    angle = 2 * np.pi * np.arange(columns) / columns
    wall_m = 4.0 / np.maximum(abs(np.sin(angle)), abs(np.cos(angle)))
    metres = wall_m[:, None] + random.normal(0, 0.006, (columns, kind.layout.lasers))
    ranges = np.rint(metres / 0.002).astype(np.uint16)
    ranges[random.random(ranges.shape) < 0.1] = 0
    turn = Turn(
        ranges[None],
        (np.arange(blocks) * (36000 // blocks)).astype(np.uint16),
        (np.arange(packets) * 1327).astype(np.uint32),
        (20 + 10 * np.sin(3 * angle))[None, :, None].repeat(len(ranges[0]), 2).astype(np.uint8),
    )
    return kind.returns([turn])

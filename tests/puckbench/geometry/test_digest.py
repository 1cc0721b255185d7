"""Digests of clouds depend on points and order, not on rounding."""

import numpy as np

from pointkit.seeding import generator
from puckbench.geometry.digest import cloud_digest


def test_digest_depends_on_points_and_order_not_on_the_last_bits() -> None:
    points = generator(1, "digest").uniform(0, 1023, (1000, 3))
    original = cloud_digest(points)
    rounded = np.rint(points * 1000) / 1000
    assert cloud_digest(rounded * (1 + 1e-13)) == cloud_digest(rounded) == original
    moved = points.copy()
    moved[7, 1] += 0.01
    assert len({original, cloud_digest(moved), cloud_digest(points[::-1])}) == 3


def test_metres_are_rounded_to_micrometres() -> None:
    points = np.zeros((3, 3))
    moved = points + 2e-6
    assert cloud_digest(points) == cloud_digest(moved)
    assert cloud_digest(points, metric=True) != cloud_digest(moved, metric=True)

"""A scan of a flat floor and of a wall, with the classes of the label set `rooms`."""

from __future__ import annotations

import numpy as np

from lidar_segmentation import LabelledScan, SegmentationTraining, class_map

SETTINGS = SegmentationTraining(
    labels="rooms", cells=32, cell_m=0.4, bottom_m=-1.5, bin_m=0.5, bins=6, crop_cells=16,
    channels=(8, 8, 8, 8), hidden=16, steps=40, batch_size=2, learning_rate=1e-2, points=500,
    near_cells=5, height_m=0.1,
)  # fmt: skip
FLOOR, WALL = (class_map("rooms").classes.index(name) for name in ("floor", "wall"))


def scan(seed: int, points: int = 2000) -> LabelledScan:
    """Return half of the points on a floor at z = -1.3 m, half on a wall at x = 3 m."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-5, 5, (points, 3))
    wall = np.arange(points) % 2 == 1
    xyz[~wall, 2] = -1.3
    xyz[wall, 0] = 3.0
    xyz[wall, 2] = rng.uniform(-1.0, 1.0, wall.sum())
    classes = np.where(wall, WALL, FLOOR).astype(np.uint8)
    return LabelledScan(xyz.astype(np.float32), classes)

"""Frames of KITTI that are written from known returns."""

from __future__ import annotations

import numpy as np

from pointkit.lidar.returns import Beams, Returns
from pointkit.lidar.turns import Layout, Turn


def hdl64(columns: int = 400) -> Returns:
    """A turn of a sensor with each laser's own height, angle and offset, firing irregularly."""
    random = np.random.default_rng(3)
    lasers = 64
    elevations = np.linspace(-23.5, 2.0, lasers)
    order = tuple(range(lasers))
    steps = np.sort(random.choice(4000, columns, replace=False))
    sideways = np.where(np.arange(lasers) % 2, 26.0, -26.0) + random.uniform(-0.5, 0.5, lasers)
    beams = Beams(
        tuple(elevations.tolist()),
        tuple(np.linspace(117, 209, lasers).tolist()),
        (0.0,) * lasers,
        clockwise=False,
        azimuths_deg=tuple(random.uniform(-7, 7, lasers).tolist()),
        sideways_mm=tuple(sideways.tolist()),
    )
    ranges = random.integers(2000, 30_000, (1, columns, lasers)).astype(np.uint16)
    ranges[random.random(ranges.shape) < 0.1] = 0
    turn = Turn(ranges, (steps * 9).astype(np.uint16))
    return Returns(beams, Layout(order), (turn,), 0.002, "HDL-64E")


def as_kitti(returns: Returns) -> bytes:
    """The points in KITTI's axes and order, in whole millimetres."""
    lasers = np.nonzero(returns.turns[0].ranges[0])[1]
    x, y, z = returns.points().T
    azimuth = np.mod(np.arctan2(-x, y), 2 * np.pi)
    rows = np.lexsort([azimuth, -lasers])
    table = np.column_stack([y, -x, z, np.zeros(len(x))])[rows]
    return np.round(table, 3).astype("<f4").tobytes()

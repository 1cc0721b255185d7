"""Returns of spinning sensors for tests: recorded ones, and those of two sensors of nobody's."""

from __future__ import annotations

import numpy as np

from pointkit.lidar.returns import Beams, Returns
from pointkit.lidar.turns import Layout, Turn
from puck.recordings.packet_turns import returns_of_packets
from tests.support.spinning import DUAL, spin


def recorded(packets: int = 150) -> Returns:
    """Two turns of a VLP-16 that returns the strongest alone."""
    return returns_of_packets(spin(packets=packets))


def dual() -> Returns:
    """Turns of a VLP-16 with two returns of each beam."""
    return returns_of_packets(spin(mode=DUAL, packets=60))


def homemade(columns: int = 90, seed: int = 3) -> Returns:
    """A turn of a sensor of five lasers with a quantum of 4 mm, which no packet could hold."""
    random = np.random.default_rng(seed)
    angle = np.arange(columns) / columns * 2 * np.pi
    ranges = 1500 + 400 * np.sin(2 * angle)[:, None] + random.normal(0, 3, (columns, 5))
    ranges[random.random(ranges.shape) < 0.2] = 0
    azimuths = np.arange(columns, dtype=np.uint16) * (36000 // columns)
    turn = Turn(np.rint(ranges).astype(np.uint16)[None], azimuths.astype(np.uint16))
    beams = Beams((4.0, -8.0, 0.0, 9.5, -3.0), (0.0, 5.0, 0.0, 0.0, 1.5), (0, 0.2, 0.4, 0.6, 0.8))
    return Returns(beams, Layout((1, 4, 2, 0, 3)), (turn, turn), 0.004, "Homemade")


def staggered(columns: int = 128, seed: int = 4) -> Returns:
    """Two turns of a sensor like an Ouster's: the lasers of a column fire at once, from beside the
    axis and with azimuths of their own; ranges do not fit in 16 bits."""
    random = np.random.default_rng(seed)
    lasers, shifts = 20, np.array([3, 1, -1, -3] * 5)
    turns = []
    for number in range(2):
        column = np.arange(columns)[:, None] + shifts
        angle = (column + 2 * number) / columns * 2 * np.pi
        ranges = 45_000 + 30_000 * np.sin(angle) + 50 * np.arange(lasers)
        ranges += random.normal(0, 3, ranges.shape)
        ranges[random.random(ranges.shape) < 0.1] = 0
        shades = (100 + 90 * np.cos(angle) + random.integers(0, 3, ranges.shape)).astype(np.uint8)
        turns.append(
            Turn(
                np.rint(ranges).astype(np.uint32)[None],
                np.arange(columns, dtype=np.uint16),
                (np.arange(columns // 16) * 1563 + 100_000 * number).astype(np.uint32),
                shades[None],
            )
        )
    beams = Beams(
        tuple(np.linspace(20, -22, lasers).tolist()),
        tuple(np.linspace(30, 40, lasers).tolist()),
        (0.0,) * lasers,
        azimuths_deg=tuple((shifts * 360 / columns + 0.1).tolist()),
        sideways_mm=(0.0,) * lasers,
        radial_mm=(27.67,) * lasers,
    )
    order = tuple(range(lasers))[::-1]
    layout = Layout(order, blocks_per_time=16, azimuth_steps=columns, shifts=tuple(shifts.tolist()))
    return Returns(beams, layout, tuple(turns), 0.002, "Staggered", -0.02767)


EXAMPLES = {"recorded": recorded, "dual": dual, "homemade": homemade, "staggered": staggered}

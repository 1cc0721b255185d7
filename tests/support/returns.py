"""Returns of spinning sensors for tests: recorded ones, and those of a sensor of nobody's."""

from __future__ import annotations

import numpy as np

from puckbench.lidar.recordings.packet_turns import returns_of_packets
from puckbench.lidar.returns import Beams, Returns
from puckbench.lidar.turns import Layout, Turn
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


EXAMPLES = {"recorded": recorded, "dual": dual, "homemade": homemade}

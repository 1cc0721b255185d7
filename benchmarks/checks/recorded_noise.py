"""The noise in the bits of recordings (arguments) of a VLP-16 that stands still.

Each range is compared with the line between its two neighbours in azimuth in the next turn. The
differences, scaled to the variance of one range, bound its noise; edges (50 mm) are left out.
"""

import sys
from itertools import pairwise

import numpy as np

import puckbench
from pointkit.geometry.cloud import Floats
from puckbench.metrics.sensor_metrics import entropy_bits

EDGE_M, APART_RAD = 0.05, 0.01


def differences(first: Floats, second: Floats) -> Floats:
    """Return the scaled differences (m) of two turns' points (n, 3)."""
    parts = []
    for elevation in range(-15, 16, 2):
        lasers = []
        for x, y, z in (first.T, second.T):
            near = np.abs(np.degrees(np.arctan2(z, np.hypot(x, y))) - elevation) < 0.5
            rows = np.array([np.arctan2(y, x), np.sqrt(x * x + y * y + z * z)])[:, near]
            lasers.append(rows[:, np.argsort(rows[0])])
        (azimuth, ranges), (others, other_ranges) = lasers
        after = np.clip(np.searchsorted(others, azimuth), 1, len(others) - 1)
        span, step = (values[after] - values[after - 1] for values in (others, other_ranges))
        weight = (azimuth - others[after - 1]) / np.maximum(span, 1e-9)
        change = ranges - other_ranges[after - 1] - weight * step
        is_flat = (np.abs(step) < EDGE_M) & (np.abs(change) < EDGE_M) & (span < APART_RAD)
        kept = is_flat & (weight >= 0) & (weight <= 1)
        parts.append((change / np.sqrt(1 + weight**2 + (1 - weight) ** 2))[kept])
    return np.concatenate(parts)


puck = puckbench.open_codec("puck", {"options": {"reflectivities": False}})
for path in sys.argv[1:]:
    turns = list(puckbench.turns(path))
    noise = np.concatenate([differences(a.xyz, b.xyz) for a, b in pairwise(turns)])
    entropy = entropy_bits(noise, np.zeros(len(noise), int), 0.002)
    bits = np.mean([8 * len(puckbench.encoded(puck, turn, "2mm")) / len(turn) for turn in turns])
    share = len(noise) / sum(map(len, turns[:-1]))
    print(f"{path}: {1e3 * noise.std():.1f} mm, {entropy:.2f} of {bits:.2f} bits ({share:.0%})")

"""G-PCC's modes on the turns of a recorded drive, on the same grid, so that all decode alike.

    python -m benchmarks.claims.turns_of_a_drive TURN.bin ... [--steps-mm 20 10]

Turns are float32 x, y, z and reflectance in m, laser by laser from the highest down (KITTI). The
lasers' elevations and heights are fitted to all turns by least squares, and travel in the streams.
Printed are bits per point of the octree as papers run it (`angularEnabled: 0`), of the angular
octree, and of predictive geometry in the sensor's coordinates, each with equal grid points merged
and kept, and how far the points lie from the fitted cones. All turns are one scene: the extremes
of the ratios to the octree are of its turns.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gpcc import (
    PROFILES,
    PredictiveOptions,
    SensorDescription,
    encode_geometry,
    encode_predictive_geometry,
    quantise,
)
from pointkit.geometry.cloud import Floats
from puckbench.metrics.statistics import Estimate

LASERS = 64
LEAP_DEG = 36.0
"""Decrease of the azimuth at which the next laser begins."""
COLUMNS_PER_TURN = 2083
OCTREE = "octree"


def by_laser(points: Floats) -> list[Floats]:
    """Return the points of each laser of a turn."""
    azimuth = np.degrees(np.arctan2(points[:, 1], points[:, 0])) % 360
    return np.split(points, np.flatnonzero(np.diff(azimuth) < -LEAP_DEG) + 1)


def fitted(turns: list[Floats]) -> tuple[list[tuple[float, float]], float]:
    """Return tangent and height (m) of each laser, and the RMS distance in z from its cone, in m.

    Turns that do not split into as many parts as there are lasers are left out.
    """
    parts = [lasers for turn in turns if len(lasers := by_laser(turn)) == LASERS]
    lines, squares, count = [], 0.0, 0
    for number in range(LASERS):
        points = np.concatenate([lasers[number] for lasers in parts])
        radius = np.hypot(points[:, 0], points[:, 1])
        weight = 1 / np.maximum(radius, 1)
        matrix = np.column_stack([radius, np.ones_like(radius)])
        line = np.linalg.lstsq(matrix * weight[:, None], points[:, 2] * weight, rcond=None)[0]
        squares += float(((points[:, 2] - matrix @ line) ** 2).sum())
        count += len(points)
        lines.append((float(line[0]), float(line[1])))
    return lines, (squares / count) ** 0.5


def bits(points: Floats, lines: list[tuple[float, float]], step: float) -> Mapping[str, float]:
    """Return bits per point of each mode on a grid with a step in m."""
    tangents, heights = zip(*lines, strict=True)
    sensor = SensorDescription(tangents, tuple(h / step for h in heights), COLUMNS_PER_TURN)
    grid, origin = quantise(points, scale=1 / step)
    found: dict[str, float] = {}
    frame: dict[str, Any] = {"scale": 1 / step, "origin": origin}
    for is_merged, words in ((True, "merged"), (False, "all points")):
        tools = PROFILES["spinning"].model_copy(
            update={"merge_duplicates": is_merged, "inferred_direct_coding_mode": 1}
        )
        trees = PredictiveOptions(merge_duplicates=is_merged)
        streams = {
            OCTREE: encode_geometry(grid, tools, **frame),
            "angular octree": encode_geometry(grid, tools, sensor=sensor, **frame),
            "predictive geometry": encode_predictive_geometry(grid, trees, sensor=sensor, **frame),
        }
        for name, stream in streams.items():
            found[f"{name}, {words}"] = 8 * len(stream) / len(points)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("turns", nargs="+", type=Path)
    parser.add_argument("--steps-mm", nargs="+", type=float, default=[20.0, 10.0])
    options = parser.parse_args()
    rows = [np.fromfile(path, "<f4").reshape(-1, 4) for path in options.turns]
    turns = [part[:, :3].astype(np.float64) for part in rows]
    lines, rms = fitted(turns)
    print(f"{len(turns)} turns, {rms * 1000:.1f} mm RMS from the cones")
    for step_mm in options.steps_mm:
        table = pd.DataFrame([bits(turn, lines, step_mm / 1000) for turn in turns])
        print(f"\nstep {step_mm:g} mm")
        for name in table:
            kept = str(name).partition(", ")[2]
            ratio = Estimate.of_ratios(table[name] / table[f"{OCTREE}, {kept}"])
            ends = f"{ratio.least:.3f} to {ratio.most:.3f}"
            print(f"  {name}: {table[name].mean():.2f} bits, {ratio.mean:.3f} ({ends})", flush=True)


if __name__ == "__main__":
    main()

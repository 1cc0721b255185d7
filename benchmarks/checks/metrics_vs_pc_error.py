"""Time and values of the metrics against MPEG's pc_error, side by side on one pair of clouds.

    python -m benchmarks.checks.metrics_vs_pc_error PC_ERROR [--threads 2] [--repeats 5]
        [--pair ties]

PC_ERROR is the tool's binary. Its time is the one it prints, without reading, sorting and merging
duplicates; ours is of the whole `distortion` on arrays in memory, duplicates and spatial order
included. The least time of the repeats counts: other work on the machine only adds.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.performance.rows import Inputs, Row

from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.seeding import generator

ROOM = np.array([6.2, 4.1, 2.8])
SENSOR = np.array([3.0, 1.9, 1.3])
LINES = {
    "acd_ab_point": r"mse1 +\(p2point\)",
    "acd_ba_point": r"mse2 +\(p2point\)",
    "d1_mse": r"mseF +\(p2point\)",
    "hausdorff_sq_point": r"h\. +\(p2point\)",
    "acd_ab_plane": r"mse1 +\(p2plane\)",
    "acd_ba_plane": r"mse2 +\(p2plane\)",
    "d2_mse": r"mseF +\(p2plane\)",
    "hausdorff_sq_plane": r"h\. +\(p2plane\)",
}


def scanned_room(points: int) -> PointCloud:
    """Noisy returns from the walls of a room in a cube of 1023 units, with noisy normals."""
    random = generator(0, "metrics benchmark")
    azimuth = np.sort(random.uniform(0, 2 * np.pi, points))
    sine = random.uniform(-0.95, 0.95, points)
    cosine = np.sqrt(1 - sine**2)
    rays = np.column_stack([cosine * np.cos(azimuth), cosine * np.sin(azimuth), sine])
    ranges = np.where(rays > 0, (ROOM - SENSOR) / rays, -SENSOR / rays)
    wall = ranges.argmin(axis=1)
    ranges = ranges.min(axis=1) + random.normal(0, 0.012, points)
    xyz = SENSOR + ranges[:, None] * rays
    xyz = (xyz - xyz.min(axis=0)) * (1023 / np.ptp(xyz, axis=0).max())
    normals = random.normal(0, 0.15, (points, 3))
    normals[np.arange(points), wall] += 1
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return PointCloud(single(xyz), single(normals))


def single(values: Floats) -> Floats:
    """Values that the tool, which reads in single precision, sees as we do."""
    return values.astype(np.float32).astype(np.float64)


def make_pair(kind: str, points: int) -> tuple[PointCloud, Floats]:
    """A noisy room and its decode of half as many points; "ties" puts the room on a grid too."""
    room = scanned_room(points)
    if kind == "ties":
        grid, rows = np.unique(np.rint(room.xyz), axis=0, return_index=True)
        assert room.normals is not None
        return PointCloud(grid, room.normals[rows]), np.unique(np.rint(grid / 2) * 2, axis=0)
    return room, single(np.unique(np.rint(room.xyz / 2.75), axis=0) * 2.75)


def write_ply(path: Path, cloud: PointCloud) -> None:
    """Single-precision PLY, the only one whose normals the tool reads."""
    columns = {"x y z": cloud.xyz, "nx ny nz": cloud.normals}
    present = {names: values for names, values in columns.items() if values is not None}
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}"]
    header += [f"property float {name}" for names in present for name in names.split()]
    rows = np.column_stack(list(present.values())).astype("<f4")
    path.write_bytes("\n".join([*header, "end_header\n"]).encode() + rows.tobytes())


def run_tool(tool: Path, folder: Path, threads: int) -> dict[str, float]:
    clouds = ["-a", str(folder / "a.ply"), "-b", str(folder / "b.ply")]
    command = [str(tool), *clouds, "-r", "1023", "-d", "1"]
    command += [f"--nbThreads={threads}"]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    found = {key: re.search(rf"{line}: (\S+)", printed) for key, line in LINES.items()}
    found["seconds"] = re.search(r"Job done! (\S+) seconds", printed)
    return {key: float(match[1]) for key, match in found.items() if match}


def run_ours(reference: PointCloud, decoded: Floats) -> dict[str, float]:
    from puckbench.metrics.geometry import distortion

    start = time.perf_counter()
    values = distortion(reference, decoded)
    return {**values, "seconds": time.perf_counter() - start}


def measure(inputs: Inputs) -> Iterator[Row]:
    tool, repeats = Path(inputs.program("PC_ERROR")), inputs.repeats(3)
    os.environ["OMP_NUM_THREADS"] = "1"
    points = 5000 if inputs.is_trial else 1_152_000
    for pair in ("noisy", "ties"):
        found = compare(tool, pair, points, 1, repeats)
        what, rival = f"{pair}, {points:,} points", ("pc_error", found["tool_s"])
        yield Row(f"{what}: all distortions", found["ours_s"], "s", *rival, 1, repeats=repeats)
        yield Row(f"{what}: largest relative difference", found["difference"], "of a value")


def compare(tool: Path, pair: str, points: int, threads: int, repeats: int) -> dict[str, Any]:
    """Run both in turns; least times, their ratio and the largest relative difference."""
    reference, decoded = make_pair(pair, points)
    run_ours(reference.select(np.arange(1000)), decoded[:1000])
    with tempfile.TemporaryDirectory() as folder:
        write_ply(Path(folder) / "a.ply", reference)
        write_ply(Path(folder) / "b.ply", PointCloud(decoded))
        runs = [
            (run_tool(tool, Path(folder), threads), run_ours(reference, decoded))
            for _ in range(repeats)
        ]
    theirs, ours = zip(*runs, strict=True)
    tool_s, ours_s = (min(run["seconds"] for run in side) for side in (theirs, ours))
    return {
        "points": (len(reference), len(decoded)),
        "threads": threads,
        "tool_s": tool_s,
        "ours_s": round(ours_s, 3),
        "ratio": round(ours_s / tool_s, 3),
        "difference": max(abs(ours[0][key] / theirs[0][key] - 1) for key in LINES),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tool", type=Path)
    parser.add_argument("--threads", type=int, default=1, help="of both (default: the tool's, 1)")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--points", type=int, default=1_152_000)
    parser.add_argument("--pair", choices=("noisy", "ties"), default="noisy")
    options = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = str(options.threads)
    for name, value in compare(**vars(options)).items():
        print(f"{name}: {value}")


if __name__ == "__main__":
    main()

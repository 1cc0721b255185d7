"""Blender's ray caster against ours: the same rays at the same scenes, distances and times.

    python -m benchmarks.checks.blender.compare PYTHON_WITH_BPY [--mesh FILE] [--repeats 3]

PYTHON_WITH_BPY is the interpreter of an environment of its own: `pip install 'bpy==4.5.*'
'numpy<2'` (1 GB, Python 3.11). The rays are the 1,152,000 of a sweep. Ray by ray Blender's
distances (`Scene.ray_cast`, and `BVHTree.ray_cast`, which BlenSor's scanner does in C) are compared
with ours; rays on which the two do not agree are worked out again in float64 against all triangles,
which tells who is right and how near to an edge the ray passes. Times are the least of the repeats.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.performance.scan_speed import least_times
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from pointkit.lidar.sensors import load_sensor
from puckbench.geometry.surfaces import read_surface
from virtual_lidar import ScanJob, Sweep, free_origin, open_error_model
from virtual_lidar.raycast import RayCaster
from virtual_lidar.scenes.calibration import calibration_origin, make_calibration
from virtual_lidar.scenes.rooms import make_room

SENSOR, SWEEP = load_sensor("vlp16"), Sweep()
FARTHEST_M = 100.0
# Two distances of one surface differ by float32's rounding only, which is below this share of them
# but where the ray grazes.
SAME_SURFACE = 1e-4


@dataclass(frozen=True)
class Scene:
    name: str
    mesh: Mesh
    origin: Floats


@dataclass(frozen=True)
class Ours:
    """Our cast: directions as float32 holds them (n, 3), angles, distances, incidence, (n,)."""

    directions: Floats
    angles: Floats
    distances: Floats
    incidence: Floats
    cast: Floats
    scan: Floats
    """Wall-clock and processor seconds."""


def scenes(mesh: Path | None) -> list[Scene]:
    office, store = make_room("office_1", seed=1), make_room("storage_1", seed=1)
    wall_floor = "wall_floor_5m"
    found = [
        Scene("furnished office", office, free_origin(office)),
        Scene(
            "wall and floor", make_calibration(wall_floor), np.array(calibration_origin(wall_floor))
        ),
        Scene("storage room", store, free_origin(store)),
    ]
    if mesh is not None:
        read = read_surface(mesh)
        found.append(Scene(mesh.stem, read, free_origin(read)))
    return found


def cast_by_us(scene: Scene, repeats: int) -> Ours:
    caster, frames = RayCaster(scene.mesh, scene.origin), range(SWEEP.frames)
    rays, poses = SWEEP.rays(SENSOR, frames), SWEEP.poses(SENSOR, frames)
    cast = caster.cast(rays, poses, (0.0, FARTHEST_M))
    # What Blender gets: its vectors are float32, and it makes them of length 1 again.
    single = cast.directions.astype(np.float32)
    directions = single.astype(np.float64)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    start = np.zeros((len(single), 3))
    hits = caster.hits(directions, start, (len(single),), (0.0, FARTHEST_M))
    job = ScanJob(scene.mesh, SENSOR, SWEEP, open_error_model("vlp16"), scene.origin)
    times = least_times(
        [lambda: caster.met(start, directions), lambda: job.table(np.random.default_rng(0))],
        repeats,
    )
    return Ours(
        directions,
        np.column_stack([rays.yaw.ravel(), rays.pitch.ravel()]),
        hits.distance,
        hits.incidence,
        *times,
    )


def cast_by_blender(python: str, scene: Scene, ours: Ours, repeats: int) -> dict[str, NDArray[Any]]:
    with tempfile.TemporaryDirectory() as folder:
        given, answer = Path(folder, "scene.npz"), Path(folder, "answer.npz")
        np.savez(
            given,
            vertices=scene.mesh.vertices - scene.origin,
            triangles=scene.mesh.triangles,
            rays=ours.directions,
            angles=ours.angles,
            farthest=FARTHEST_M,
        )
        program = str(Path(__file__).with_name("cast.py"))
        subprocess.run([python, program, str(given), str(answer), str(repeats)], check=True)
        return dict(np.load(answer))


def exact(corners: Floats, direction: Floats) -> float:
    """Least distance at which a ray meets triangles (t, 3, 3) in float64, inf for none."""
    first, one, two = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(direction, two)
    determinant = (one * across).sum(axis=1)
    over = np.cross(-first, one)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = -(first * across).sum(axis=1) / determinant
        v = over @ direction / determinant
        reach = (two * over).sum(axis=1) / determinant
    struck = (u >= 0) & (v >= 0) & (u + v <= 1) & (reach > 0) & (reach <= FARTHEST_M)
    return float(reach[struck].min(initial=np.inf))


def gap_to_an_edge(corners: Floats, direction: Floats, reach: float) -> float:
    """Distance from a ray to the nearest edge of a triangle within 10 % of `reach`, m."""
    starts = corners.reshape(-1, 3)
    sides = np.roll(corners, -1, axis=1).reshape(-1, 3) - starts
    across = np.cross(direction, sides)
    squared = np.maximum((across**2).sum(axis=1), 1e-300)
    along = (np.cross(starts, direction) * across).sum(axis=1) / squared
    near = starts + np.clip(along, 0, 1)[:, None] * sides
    depth = near @ direction
    gap = np.linalg.norm(near - depth[:, None] * direction, axis=1)
    return float(gap[np.abs(depth / reach - 1) < 0.1].min(initial=np.inf))


def report(scene: Scene, ours: Ours, theirs: dict[str, NDArray[Any]], way: str) -> None:
    """Print how far the distances differ, and explain the rays that hit different surfaces."""
    other = theirs[way]
    both = np.isfinite(ours.distances) & np.isfinite(other)
    difference = np.abs(np.where(both, ours.distances, 0) - np.where(both, other, 0))
    cosine = np.cos(np.where(both, ours.incidence, 0))
    same = both & (difference * cosine < SAME_SURFACE)
    print(
        f"  {way:5s} {both.sum():,} hits of both: largest difference {difference[same].max():.1e} m"
    )
    print(
        f"        ({(difference * cosine)[same].max():.1e} m along the normal), median"
        f" {np.median(difference[same]):.1e} m"
    )
    odd = np.flatnonzero(both & ~same)
    only_ours = np.flatnonzero(np.isfinite(ours.distances) & ~np.isfinite(other))
    only_theirs = np.flatnonzero(~np.isfinite(ours.distances) & np.isfinite(other))
    print(f"        another surface {len(odd)}, only ours {len(only_ours)}, only", end=" ")
    print(f"Blender's {len(only_theirs)}")
    explain(scene, ours, other, np.concatenate([odd, only_ours, only_theirs])[:200])


def explain(scene: Scene, ours: Ours, other: Floats, rays: NDArray[np.int64]) -> None:
    """Print who is right on these rays, by float64, and how near to an edge they pass."""
    if not len(rays):
        return
    corners = (scene.mesh.vertices - scene.origin)[scene.mesh.triangles]
    true = np.array([exact(corners, direction) for direction in ours.directions[rays]])
    nearer = np.minimum(ours.distances[rays], other[rays])
    gaps = [
        gap_to_an_edge(corners, direction, reach)
        for direction, reach in zip(ours.directions[rays], nearer, strict=True)
    ]
    mine, theirs = (np.isclose(found[rays], true, rtol=1e-4) for found in (ours.distances, other))
    print(
        f"        by float64 ours is right on {mine.sum()}, Blender on {theirs.sum()} of", end=" "
    )
    print(f"{len(rays)}; they pass an edge at {max(gaps):.1e} m or nearer")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("python", help="interpreter that has bpy")
    parser.add_argument("--mesh", type=Path, help="this mesh or captured room (JSON) as well")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    for scene in scenes(options.mesh):
        ours = cast_by_us(scene, options.repeats)
        theirs = cast_by_blender(options.python, scene, ours, options.repeats)
        print(f"{scene.name}: {len(scene.mesh.triangles):,} triangles, Blender {theirs['version']}")
        for way in ("scene", "tree"):
            report(scene, ours, theirs, way)
        report_times(ours, np.array(theirs["seconds"]))


def report_times(ours: Ours, theirs: Floats) -> None:
    """Print rays per second of processor time, and the times of a scan with range noise."""
    by_scene, by_tree, blensor = theirs
    millions = len(ours.distances) / 1e6
    print(f"  million rays per processor second: ours {millions / ours.cast[1]:.2f},", end=" ")
    print(f"Scene.ray_cast {millions / by_scene[1]:.2f},", end=" ")
    print(f"BVHTree.ray_cast {millions / by_tree[1]:.2f}")
    print("  a scan with range noise, on the wall and of the processors: as BlenSor", end=" ")
    print(f"{blensor[0]:.1f} and {blensor[1]:.1f} s, ours", end=" ")
    print(f"{ours.scan[0]:.2f} and {ours.scan[1]:.2f} s")


if __name__ == "__main__":
    main()

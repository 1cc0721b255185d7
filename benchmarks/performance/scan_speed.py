"""Time of a full sweep, mesh in memory to table in memory, beside the bare ray cast.

    python -m benchmarks.performance.scan_speed [--room NAME | --cells N] [--errors NAME ...]
        [--repeats N]

Prints the least time of N runs of the bare cast of the same 1,152,000 rays in one call and of the
scan with each error model, in turn, as the machine may be loaded by others; the time of the
processors is printed beside it, which such a load lengthens little. Then of writing and reading the
table. `--cells 408` makes a room of 2 M triangles.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh
from puckbench.lidar import (
    ScanTable,
    Sweep,
    error_model_names,
    free_origin,
    load_sensor,
    open_error_model,
    read_scan,
    scan,
    write_scan,
)

SENSOR, SWEEP = load_sensor("vlp16"), Sweep()
OPTIONS = {
    "distance_table": {"table": [[1, 0, 0.01], [100, 0, 0.03]]},
    "calibrated": {"ray_sigma_m": 0.006},
}


@dataclass(frozen=True)
class Times:
    """Least seconds of several runs: on the wall, and of all processors together."""

    wall: float
    processor: float


def least_times(actions: list[Callable[[], object]], repeats: int) -> list[Times]:
    """Times of the actions, run in turn so that a load by others falls on all of them."""
    found: list[list[Times]] = [[] for _ in actions]
    for _ in range(repeats + 1):
        for action, times in zip(actions, found, strict=True):
            start, used = time.perf_counter(), time.process_time()
            action()
            times.append(Times(time.perf_counter() - start, time.process_time() - used))
    return [
        Times(min(one.wall for one in times[1:]), min(one.processor for one in times[1:]))
        for times in found
    ]


def least_time(action: Callable[[], object], repeats: int) -> float:
    return least_times([action], repeats)[0].wall


def tessellated_room(cells: int = 64, clutter: int = 3000) -> Mesh:
    """A box room of `cells`^2 squares a side with triangles adrift in it: 52,152 triangles."""
    steps = np.linspace(0, 1, cells + 1)
    plane = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    corner = np.arange(cells * (cells + 1)).reshape(cells, -1)[:, :cells].ravel()
    lower = np.stack([corner, corner + 1, corner + cells + 1], axis=1)
    upper = np.stack([corner + 1, corner + cells + 2, corner + cells + 1], axis=1)
    square = np.concatenate([lower, upper])
    sides = [np.insert(plane, axis, end, axis=1) for axis in range(3) for end in (0, 1)]
    rng = np.random.default_rng(0)
    middles = rng.uniform(0.05, 0.95, (clutter, 1, 3)) * [6, 5, 3]
    adrift = (middles + rng.normal(0, 0.03, (clutter, 3, 3))).reshape(-1, 3)
    vertices = np.concatenate([np.concatenate(sides) * [6, 5, 3], adrift])
    triangles = [square + side * len(plane) for side in range(6)]
    triangles.append(np.arange(3 * clutter).reshape(-1, 3) + 6 * len(plane))
    return Mesh(vertices, np.concatenate(triangles))


def room(name: str | None, cells: int) -> Mesh:
    if name is None:
        return tessellated_room(cells)
    from puckbench.scenes.rooms import make_room

    return make_room(name, seed=1)


def bare_cast(mesh: Mesh, origin: Floats) -> Callable[[], object]:
    """The cast alone: scene built, rays ready, one call."""
    import open3d as o3d

    table = scan(mesh, SENSOR, SWEEP, open_error_model("none"), origin, np.random.default_rng(0))
    rays = np.zeros((len(table), 6), dtype=np.float32)
    rays[:, 3:] = (table.xyz - origin) / table["distance"][:, None]
    start = time.perf_counter()
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor.from_numpy((mesh.vertices - origin).astype(np.float32)),
        o3d.core.Tensor.from_numpy(mesh.triangles.astype(np.uint32)),
    )
    tensor = o3d.core.Tensor.from_numpy(rays)
    scene.cast_rays(tensor[:1])
    built = time.perf_counter() - start
    print(
        f"{len(mesh.triangles):,} triangles (scene built in {built:.2f} s, part of a scan and not"
        f" of a bare cast), {len(table):,} returns"
    )
    return lambda: scene.cast_rays(tensor)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--room", help="a generated room's name; a cluttered box if not given")
    parser.add_argument("--cells", type=int, default=64, help="squares along a side of the box")
    parser.add_argument("--errors", nargs="+", default=error_model_names())
    parser.add_argument("--repeats", type=int, default=7)
    options = parser.parse_args()
    mesh = room(options.room, options.cells)
    origin = free_origin(mesh)
    bare = bare_cast(mesh, origin)

    def scanned(errors: str) -> ScanTable:
        model = open_error_model(errors, OPTIONS.get(errors))
        return scan(mesh, SENSOR, SWEEP, model, origin, np.random.default_rng(0))

    for errors in options.errors:
        cast, taken = least_times([bare, partial(scanned, errors)], options.repeats)
        print(
            f"scan, {errors:17s} {taken.wall:.3f} s, bare cast {cast.wall:.3f} s:"
            f" {taken.wall / cast.wall:.1f} casts;"
            f" processors {taken.processor:.2f} and {cast.processor:.2f} s"
        )
    table = scanned("vlp16")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scan.parquet"
        print(f"write {least_time(lambda: write_scan(path, table), options.repeats):.3f} s", end="")
        print(f", read {least_time(lambda: read_scan(path), options.repeats):.3f} s", end="")
        print(f", {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()

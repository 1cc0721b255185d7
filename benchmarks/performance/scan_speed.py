"""Time of a full sweep, mesh in memory to table in memory, beside the bare ray cast.

    python -m benchmarks.performance.scan_speed [--room NAME] [--errors NAME ...] [--repeats N]
        [--step 0.1]

The bare cast of the same rays in one call and the scan with each error model take turns, and the
least time of the repeats counts: wall clock, and processor time, which other work lengthens little.
A step of 0.1 deg makes 1,152,000 rays. The aims are multiples of the bare cast's wall clock, on an
idle machine of two cores; a model that casts other rays than the nominal ones may take longer.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from benchmarks.performance.rows import Inputs, Row

from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh
from pointkit.lidar.sensors import load_sensor
from virtual_lidar import (
    ScanTable,
    Sweep,
    error_model_names,
    free_origin,
    open_error_model,
    open_sweep,
    scan,
)
from virtual_lidar.scenes.rooms import make_room

RIVAL = "bare ray cast of Open3D"
SENSOR = load_sensor("vlp16")
OPTIONS: dict[str, dict[str, Any]] = {
    "distance_table": {"table": [[1, 0, 0.01], [100, 0, 0.03]]},
    "calibrated": {"ray_sigma_m": 0.006},
}
AIM_CASTS = 2.5
AIMS_CASTS = {"vlp16_divergence": 5.0, "beam_footprint": 20.0}


def least_times(actions: list[Callable[[], object]], repeats: int) -> Floats:
    """Return the least wall-clock and processor seconds (n, 2) of actions that take turns."""
    runs = np.empty((repeats + 1, len(actions), 2))
    for run in runs:
        for times, action in zip(run, actions, strict=True):
            start, used = time.perf_counter(), time.process_time()
            action()
            times[:] = time.perf_counter() - start, time.process_time() - used
    least: Floats = runs[1:].min(axis=0)
    return least


def bare_cast(mesh: Mesh, sweep: Sweep, origin: Floats) -> Callable[[], object]:
    import open3d as o3d

    table = scan(mesh, SENSOR, sweep, open_error_model("none"), origin, np.random.default_rng(0))
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
    parser.add_argument("--room", default="office_1", help="name of a generated room")
    parser.add_argument("--errors", nargs="+", default=error_model_names())
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--step", type=float, default=0.1, help="azimuth step, degrees")
    options = parser.parse_args()
    for row in scans(options.room, options.errors, options.repeats, options.step):
        print(row, flush=True)


def measure(inputs: Inputs) -> Iterator[Row]:
    step = 8.0 if inputs.is_trial else 0.1
    return scans("office_1", error_model_names(), inputs.repeats(5), step)


def scans(room: str, errors: list[str], repeats: int, step_deg: float) -> Iterator[Row]:
    mesh = make_room(room, seed=1)
    sweep, origin = open_sweep({"azimuth_step_deg": step_deg}), free_origin(mesh)
    bare = bare_cast(mesh, sweep, origin)

    def scanned(name: str) -> ScanTable:
        model = open_error_model(name, OPTIONS.get(name))
        return scan(mesh, SENSOR, sweep, model, origin, np.random.default_rng(0))

    for name in errors:
        cast, taken = least_times([bare, partial(scanned, name)], repeats).tolist()
        aims = (AIMS_CASTS.get(name, AIM_CASTS), None)
        for unit, least, rival, aim in zip(("s", "processor s"), taken, cast, aims, strict=True):
            what = f"scan of {room}, {name}"
            yield Row(what, least, unit, RIVAL, rival, at_most=aim, repeats=repeats)


if __name__ == "__main__":
    main()

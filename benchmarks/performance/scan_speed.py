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
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

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
    mesh = make_room(options.room, seed=1)
    sweep, origin = open_sweep({"azimuth_step_deg": options.step}), free_origin(mesh)
    bare = bare_cast(mesh, sweep, origin)

    def scanned(errors: str) -> ScanTable:
        model = open_error_model(errors, OPTIONS.get(errors))
        return scan(mesh, SENSOR, sweep, model, origin, np.random.default_rng(0))

    for errors in options.errors:
        cast, taken = least_times([bare, partial(scanned, errors)], options.repeats)
        casts, aim = taken[0] / cast[0], AIMS_CASTS.get(errors, AIM_CASTS)
        print(
            f"scan, {errors:17s} {taken[0]:.3f} s, bare cast {cast[0]:.3f} s: {casts:.2f} casts,"
            f" aim {aim:g} {'reached' if casts <= aim else 'missed'};"
            f" processors {taken[1]:.2f} and {cast[1]:.2f} s"
        )


if __name__ == "__main__":
    main()

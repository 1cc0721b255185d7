"""`puckbench scan`: sweep a virtual sensor over a mesh; the table of all returns."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import json_object, whole
from puckbench.core.files import read_json
from puckbench.core.progress import Progress
from puckbench.core.seeding import generator
from puckbench.geometry.cloud import Floats
from puckbench.geometry.mesh import Mesh
from puckbench.io.clouds import sidecar
from puckbench.jobs.surfaces import read_surface
from puckbench.lidar import (
    ScanJob,
    free_origin,
    load_sensor,
    open_error_model,
    open_sweep,
    write_scan,
    write_scan_portions,
)

# A longer scan is written as it goes on: this many rows are some 600 MB.
_RAYS_IN_MEMORY = 4_000_000


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("mesh", type=Path, help="mesh file, or captured room (.json)")
    parser.add_argument("out", type=Path, help="scan table to write (.parquet)")
    parser.add_argument("--sensor", default="vlp16", help="name or YAML file (default: vlp16)")
    parser.add_argument("--errors", default="none", help="error model (default: none)")
    parser.add_argument("--error-options", type=json_object, default={}, help="JSON")
    parser.add_argument(
        "--sweep",
        type=_sweep,
        default="thesis",
        help="preset, or changes to the 4 s sweep as JSON",
    )
    parser.add_argument("--origin", nargs=3, type=float, metavar=("X", "Y", "Z"), help="metres")
    parser.add_argument(
        "--height", type=float, default=1.3, help="above the floor, without --origin (default: 1.3)"
    )
    parser.add_argument(
        "--anywhere",
        action="store_true",
        help="scan from outside the scene, from inside a thing, or through walls too",
    )
    parser.add_argument("--seed", type=whole(0), default=0)


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Scan and write the table."""
    sensor, sweep = load_sensor(options.sensor), open_sweep(options.sweep)
    model = open_error_model(options.errors, options.error_options)
    mesh = read_surface(options.mesh)
    origin, vouched = _origin(options, mesh)
    job = ScanJob(mesh, sensor, sweep, model, origin, options.anywhere or vouched)
    rng, progress = generator(options.seed, "scan", options.mesh.stem), Progress("frame")
    if sweep.frames * sweep.steps(sensor) * sensor.lasers > _RAYS_IN_MEMORY:
        rows = write_scan_portions(options.out, job.portions(rng, progress))
    else:
        table = job.table(rng, progress)
        write_scan(options.out, table)
        rows = len(table)
    return {"returns": rows, "origin": [float(x) for x in origin], "errors": options.errors}


def _sweep(text: str) -> str | dict[str, Any]:
    return json_object(text) if text.startswith("{") else text


def _origin(options: argparse.Namespace, mesh: Mesh) -> tuple[Floats | list[float], bool]:
    """As given, as the scene's description says, or the nearest free spot to the middle.

    And whether the place is vouched for: a scene's describer knows what stands where.
    """
    if options.origin:
        return list(options.origin), False
    described = _described(options.mesh)
    if described is not None:
        return described, True
    return free_origin(mesh, options.height, **({"inside": 0.0} if options.anywhere else {})), False


def _described(mesh: Path) -> list[float] | None:
    """The origin in the description beside a mesh, if there is one."""
    beside = sidecar(mesh)
    about = read_json(beside) if beside != mesh and beside.exists() else None
    origin: list[float] | None = about.get("origin") if isinstance(about, dict) else None
    return origin

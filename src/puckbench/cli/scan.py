"""`puckbench scan`: sweep a virtual sensor over a mesh; the table of all returns."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from puckbench.cli.surfaces import read_surface
from puckbench.cli.types import json_object, whole
from puckbench.cloud import Floats, sidecar
from puckbench.files import read_json
from puckbench.mesh import Mesh
from puckbench.seeding import generator
from puckbench.sensor import (
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
        "--sweep", default="thesis", help="preset, or changes to the 4 s sweep as JSON"
    )
    parser.add_argument("--origin", nargs=3, type=float, metavar=("X", "Y", "Z"), help="metres")
    parser.add_argument(
        "--height", type=float, default=1.3, help="above the floor, without --origin (default: 1.3)"
    )
    parser.add_argument("--seed", type=whole(0), default=0)


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Scan and write the table."""
    sensor = load_sensor(options.sensor)
    sweep = open_sweep(_sweep(options.sweep))
    model = open_error_model(options.errors, options.error_options)
    mesh = read_surface(options.mesh)
    origin = _origin(options, mesh)
    rng = generator(options.seed, "scan", options.mesh.stem)
    job = ScanJob(mesh, sensor, sweep, model, origin)
    if sweep.frames * sweep.steps(sensor) * sensor.lasers > _RAYS_IN_MEMORY:
        rows = write_scan_portions(options.out, job.portions(rng, _progress))
    else:
        table = job.table(rng, _progress)
        write_scan(options.out, table)
        rows = len(table)
    return {"returns": rows, "origin": [float(x) for x in origin], "errors": options.errors}


def _sweep(text: str) -> str | dict[str, Any]:
    return json_object(text) if text.startswith("{") else text


def _origin(options: argparse.Namespace, mesh: Mesh) -> Floats | list[float]:
    """As given, as the scene's description says, or the nearest free spot to the middle."""
    if options.origin:
        return list(options.origin)
    beside = sidecar(options.mesh)
    described = read_json(beside).get("origin") if beside.exists() else None
    return described or free_origin(mesh, options.height)


def _progress(done: int, frames: int) -> None:
    if sys.stderr.isatty():
        end = "\n" if done == frames else ""
        print(f"\rframe {done} of {frames}", end=end, file=sys.stderr, flush=True)  # noqa: T201

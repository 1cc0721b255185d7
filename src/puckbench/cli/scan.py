from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import integer, json_object, positive, selected
from puckbench.jobs.scan import Scan


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("mesh", type=Path, help="mesh file, or captured room (.json)")
    parser.add_argument("out", type=Path, help="scan table to write (.parquet)")
    parser.add_argument(
        "--sensor", default="vlp16", help="its name, or a YAML file (default: vlp16)"
    )
    parser.add_argument("--errors", default="none", help="error model (default: none)")
    parser.add_argument(
        "--error-options", type=json_object, default={}, help="changes to its parameters (JSON)"
    )
    parser.add_argument(
        "--sweep",
        type=_sweep,
        default="thesis",
        help="name of a sweep, or changes to the sweep of 4 s (JSON)",
    )
    parser.add_argument(
        "--origin",
        nargs=3,
        type=float,
        metavar=("X", "Y", "Z"),
        help="position of the sensor, in metres",
    )
    parser.add_argument(
        "--height",
        type=float,
        default=1.3,
        help="height above the floor in metres, if no --origin is given (default: 1.3)",
    )
    parser.add_argument(
        "--anywhere",
        action="store_true",
        help="allow positions outside the scene and inside objects, and paths through walls",
    )
    parser.add_argument(
        "--metres-per-unit",
        type=positive,
        default=1.0,
        help="unit of the mesh (0.001: millimetres)",
    )
    parser.add_argument("--seed", type=integer(0), default=0)


def run(options: argparse.Namespace) -> dict[str, Any]:
    job = Scan.create(
        **selected(options, "sensor", "errors", "error_options", "sweep", "anywhere", "seed"),
        height_m=options.height,
        metres_per_unit=options.metres_per_unit,
        origin=tuple(options.origin) if options.origin else None,
    )
    return job.run(options.mesh, options.out)


def _sweep(text: str) -> str | dict[str, Any]:
    return json_object(text) if text.startswith("{") else text

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import integer, positive, selected
from puckbench.jobs.sample import Sample


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "mesh", type=Path, help="mesh file (PLY, OBJ, OFF, STL, GLB) or captured room (.json)"
    )
    parser.add_argument("out", type=Path, help="PLY file to write")
    parser.add_argument(
        "--points", type=integer(1), default=500_000, help="number of points (default: %(default)s)"
    )
    parser.add_argument(
        "--metres-per-unit",
        type=positive,
        default=1.0,
        help="unit of the mesh (0.001: millimetres)",
    )
    parser.add_argument("--seed", type=integer(0), default=0)


def run(options: argparse.Namespace) -> dict[str, Any]:
    job = Sample.create(**selected(options, "points", "seed", "metres_per_unit"))
    return job.run(options.mesh, options.out)

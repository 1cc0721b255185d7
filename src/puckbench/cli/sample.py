from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import integer, selected
from puckbench.cli.units import add_unit, surface_of
from puckbench.steps.sample import Sample


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("mesh", type=Path, help="mesh file (PLY, OBJ, OFF, STL, GLB) or captured room (.json)")
    add("out", type=Path, help="PLY file to write")
    text = "number of points (default: %(default)s)"
    add("--points", type=integer(1), default=500_000, help=text)
    add_unit(parser, "mesh")
    add("--seed", type=integer(0), default=0)


def run(options: argparse.Namespace) -> dict[str, Any]:
    step = Sample.create(**selected(options, "points", "seed"))
    return step.write(surface_of(options, options.mesh), options.mesh, options.out)

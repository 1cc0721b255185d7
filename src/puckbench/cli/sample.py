"""`puckbench sample`: points at random on the surface of a mesh, with their true normals."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from puckbench.cli.types import whole
from puckbench.core.seeding import generator
from puckbench.geometry.sampling import sample_surface
from puckbench.io.clouds import write_cloud
from puckbench.jobs.surfaces import read_surface


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "mesh", type=Path, help="mesh file (PLY, OBJ, OFF, STL, GLB) or captured room (.json)"
    )
    parser.add_argument("out", type=Path, help="PLY file to write")
    parser.add_argument("--points", type=whole(1), default=500_000, help="default: %(default)s")
    parser.add_argument("--seed", type=whole(0), default=0)


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Write the sampled cloud."""
    mesh = read_surface(options.mesh)
    rng = generator(options.seed, "sample", options.mesh.stem)
    cloud = sample_surface(mesh, options.points, rng)
    about = {"source": options.mesh.name, "seed": options.seed, "kind": "sample"}
    write_cloud(options.out, replace(cloud, about=about))
    return {**about, "points": len(cloud)}

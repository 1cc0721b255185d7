from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.registry import COMMANDS
from puckbench.cli.types import integer, json_object, selected


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", type=Path, help="table of points to write (.parquet)")
    parser.add_argument("--model", default="vlp16", help="error model (default: vlp16)")
    parser.add_argument(
        "--model-options", type=json_object, default={}, help="changes to its parameters (JSON)"
    )
    parser.add_argument(
        "--distances",
        nargs="+",
        type=float,
        default=[1.0, 5.0],
        metavar="M",
        help="distances from the sensor to the wall, in metres: 1 to 5, or 30 (default: 1 5)",
    )
    parser.add_argument("--seed", type=integer(0), default=0)
    parser.add_argument(
        "--keep",
        type=integer(1),
        help="points of each surface and distance to keep, chosen at random",
    )


@COMMANDS.register(
    "wall", arguments=arguments, help="scan a wall and a floor: the points, in the wall's frame"
)
def run(options: argparse.Namespace) -> dict[str, Any]:
    from puckbench.thesis.jobs.wall_points import WallPoints

    settings = selected(options, "model", "model_options", "seed", "keep", "distances")
    return WallPoints.create(**settings).run(options.out)

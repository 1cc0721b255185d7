from __future__ import annotations

import argparse
from typing import Any

from puckbench.cli.registry import COMMANDS
from puckbench.cli.types import selected
from puckbench.thesis.commands.residuals import scan_arguments


def arguments(parser: argparse.ArgumentParser) -> None:
    scan_arguments(parser, [1.0, 5.0], "table of points", "points of each surface and distance")


@COMMANDS.register(
    "wall", arguments=arguments, help="scan a wall and a floor: the points, in the wall's frame"
)
def run(options: argparse.Namespace) -> dict[str, Any]:
    from puckbench.thesis.jobs.wall_points import WallPoints

    settings = selected(options, "model", "model_options", "seed", "keep", "distances")
    return WallPoints.create(**settings).run(options.out)

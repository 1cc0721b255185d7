"""`puckbench scene`: one scene of a scene set, as a labelled mesh or a cloud in metres, z up."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import chosen, json_object, whole
from puckbench.jobs.scene import WriteScene


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("loader", help="loader of the scene set (see `puckbench datasets`)")
    parser.add_argument("name", help="name of the scene")
    parser.add_argument("out", type=Path, help="PLY file to write; its description goes beside it")
    parser.add_argument("--options", type=json_object, default={}, help="options of the loader")
    parser.add_argument("--seed", type=whole(0), default=0, help="of a loader that has one")


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Write the scene and its description."""
    job = WriteScene.given(**chosen(options, "loader", "name", "options", "seed"))
    return job.run(options.out)

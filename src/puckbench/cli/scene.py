from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import integer, json_object, selected
from puckbench.steps.scene import WriteScene


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("loader", help="loader of the scene set (see `puckbench datasets`)")
    add("name", help="name of the scene")
    add("out", type=Path, help="PLY file to write; its description (JSON) is written beside it")
    add("--options", type=json_object, default={}, help="options of the loader (JSON)")
    add("--seed", type=integer(0), default=0, help="seed of a loader that makes random scenes")


def run(options: argparse.Namespace) -> dict[str, Any]:
    step = WriteScene.create(**selected(options, "loader", "name", "options", "seed"))
    return step.run(options.out)

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.registry import COMMANDS
from puckbench.cli.types import integer


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--config", type=Path, default=Path("config/thesis.yaml"))
    add("--stand-in", action="store_true", help="use the generated data")
    text = "cores in the printed commands (default: 2)"
    add("--cores", type=integer(1), default=2, help=text)


@COMMANDS.register(
    "reproduce",
    arguments=arguments,
    help="list the thesis's figures and tables, and how to make those that are missing",
)
def run(options: argparse.Namespace) -> dict[str, Any]:
    from jenco2022.checklist import UNPUBLISHED, Reproduction

    changes = {"stand_in": True} if options.stand_in else {}
    reproduction = Reproduction(options.config, changes, options.cores)
    items, absent = reproduction.items(), reproduction.absent
    if options.json:
        return {"items": [vars(item) for item in items], "absent": absent}
    answer = {item.title: item.line() for item in items}
    if any(item.stand_ins for item in items):
        answer["stand-ins"] = f"after #: data that replace the thesis's ({UNPUBLISHED})"
    if absent:
        answer |= {f"data of {name}": fault for name, fault in absent.items()}
        answer["without them"] = "puckbench reproduce --stand-in"
    return answer

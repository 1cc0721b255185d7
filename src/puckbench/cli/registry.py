"""The commands of puckbench, and the commands that other packages add.

A command has two functions: `arguments` declares its arguments, and `run` does the work and returns
the answer to print. Puckbench's own commands are modules of this package, which are imported only
when they are called. Another package registers its function `run`::

    @COMMANDS.register("claims", arguments=arguments, help="show the verdicts on the claims")
    def run(options: argparse.Namespace) -> Answer: ...
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from pointkit.registry import Registry

Answer = dict[str, Any] | str | None

_HELP = {
    "run": "compare codecs on your clouds, meshes and recordings: a table and a report",
    "scene": "write a scene of a scene set as a mesh or cloud, with its description",
    "scan": "scan a mesh with a virtual sensor: a table of all returns",
    "capture": "read a recording of a spinning LiDAR: a table of its returns",
    "export": "write a scan or a capture in the format of another tool",
    "compress": "store a recording of a spinning LiDAR in a smaller file, without loss",
    "decompress": "restore a recording from a .puck file",
    "calibrate": "estimate a range error model from residuals, real or virtual",
    "sample": "sample points at random on the surface of a mesh",
    "prepare": "crop, estimate normals and scale: a cloud ready for the codecs",
    "encode": "code a cloud with a codec at a rate",
    "decode": "decode a stream",
    "train": "train a learned codec on clouds: a set of weights with its model card",
    "evaluate": "measure a decoded cloud or a coded stream against its reference",
    "recovery": "compare a stream's geometric primitives with the labels of the scene",
    "table": "make a table from other tables of a run",
    "figure": "draw a figure from the tables of a run",
    "compare": "compare codecs of a run with reference results, or with published numbers",
    "bundle": "write a run as one file to publish, which others can check and repeat",
    "verify": "check a published bundle, and repeat its run",
    "report": "write one HTML file with a run's figures, tables, curves and clouds",
    "codecs": "list the codecs: what each is for, and whether it can run here",
    "check": "check a codec of your own on small clouds: what is wrong, and what to do",
    "conformance": "test a G-PCC decoder on stored streams of the reference software",
    "datasets": "list the loaders of scene sets and their options",
    "data": "download the free published data sets",
    "completion": "print a shell script that completes commands, options and names",
}
"""Help texts of this package's commands, by name."""


@dataclass(frozen=True)
class Command:
    """A command of the command line, as `puckbench.cli.main` runs it.

    Parameters
    ----------
    name
        Name of the command.
    run
        Function that takes the parsed options, does the work, and returns the answer to print.
    arguments
        Function that adds the command's arguments to a parser.
    help
        Help text, one line.
    """

    name: str
    run: Callable[[argparse.Namespace], Answer]
    arguments: Callable[[argparse.ArgumentParser], None]
    help: str


COMMANDS: Registry[Command] = Registry("command", "commands", make=Command)
"""Commands of other packages. Printing the list of commands imports their modules."""


def help_texts() -> dict[str, str]:
    """Return the help texts of all commands, by name."""
    return {**_HELP, **{name: COMMANDS.get(name).help for name in COMMANDS.names()}}


def command(name: str) -> Command:
    """Return a command by its name, and import its module."""
    if name not in _HELP:
        return COMMANDS.get(name)
    module = import_module(f"puckbench.cli.{name}")
    return Command(name, module.run, module.arguments, _HELP[name])

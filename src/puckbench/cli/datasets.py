from __future__ import annotations

import argparse
from typing import Any

from pointkit.registry import trust
from puckbench.cli.types import json_object, refuse
from puckbench.scene_sets.registry import LOADERS, loader_class, open_scene_set


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--check", metavar="LOADER", help="count the scenes of this loader")
    add("--options", type=json_object, default={}, help="options of that loader (JSON)")


def run(options: argparse.Namespace) -> dict[str, Any]:
    """List the options of all loaders or, with ``--check``, count the scenes of one loader.

    With ``--check``, the numbers of clouds are listed beside the published ones.
    """
    if options.check:
        trust([options.check])
        return _checked(options.check, options.options)
    refuse(options, {"options": {}}, "only with --check")
    table = {name: _options(name) for name in LOADERS.names()}
    return table if options.json else {name: _line(defaults) for name, defaults in table.items()}


def _checked(loader: str, options: dict[str, Any]) -> dict[str, Any]:
    scenes = open_scene_set(loader, options)
    counts = {count.what: count.line() for count in scenes.counts()}
    return {"scenes": len(scenes.names()), **counts}


def _options(loader: str) -> dict[str, Any]:
    fields = loader_class(loader).model_fields
    return {name: "required" if o.is_required() else o.get_default() for name, o in fields.items()}


def _line(options: dict[str, Any]) -> str:
    return ", ".join(f"{name}: {value}" for name, value in options.items())

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from puckbench.cli.types import integer, json_object, refuse, selected
from puckbench.cli.units import add_unit, surface_of
from puckbench.steps.scan import Scan, described_origin


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("mesh", type=Path, help="mesh file, or captured room (.json)")
    add("out", type=Path, help="scan table to write (.parquet)")
    add("--sensor", default="vlp16", help="name, or a YAML file (default: vlp16)")
    add("--errors", default="none", help="error model (default: none)")
    text = "changes to the error model's parameters (JSON)"
    add("--error-options", type=json_object, default={}, help=text)
    text = "name of a sweep (default: thesis, of 4 s), or changes to this sweep (JSON)"
    add("--sweep", type=_sweep, default="thesis", help=text)
    text = "position of the sensor, in metres"
    add("--origin", nargs=3, type=float, metavar=("X", "Y", "Z"), help=text)
    text = "height above the floor in metres, without --origin (default: 1.3)"
    add("--height", type=float, help=text)
    text = "allow positions outside the scene and inside objects, and paths through walls"
    add("--anywhere", action="store_true", help=text)
    add_unit(parser, "mesh")
    add("--seed", type=integer(0), default=0)


def run(options: argparse.Namespace) -> dict[str, Any]:
    if options.origin:
        refuse(options, {"height": None}, "not with --origin")
    height = {} if options.height is None else {"height_m": options.height}
    step = Scan.create(
        **selected(options, "sensor", "errors", "error_options", "sweep", "anywhere", "seed"),
        **height,
        origin=tuple(options.origin) if options.origin else None,
    )
    if options.height is not None and described_origin(options.mesh):
        why = f"the description of {options.mesh} places the sensor; so does --origin"
        refuse(options, {"height": None}, why)
    prepared = step.scan_of(options.mesh, partial(surface_of, options))
    return step.write(*prepared, options.out)


def _sweep(text: str) -> str | dict[str, Any]:
    return json_object(text) if text.startswith("{") else text

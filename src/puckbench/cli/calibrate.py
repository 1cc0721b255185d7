from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import selected
from puckbench.steps.calibration import Calibrate


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("residuals", type=Path, nargs="+", help="residual tables (.parquet), one per device")
    add("out", type=Path, help="model file to write (.yaml)")
    add("--model", help="use only the rows of this model")
    text = (
        "returns that share a bias: those of a laser in one frame, or at one spot if the sensor is "
        "at rest (default: spot for captures, else frame)"
    )
    add("--cells", choices=["frame", "spot"], help=text)
    add("--parameters", nargs="+", metavar="NAME", help="sigmas to estimate (default: all)")
    text = "resolution of the ranges (default: 2 for captures, else 0)"
    add("--quantum-mm", type=float, help=text)


def run(options: argparse.Namespace) -> dict[str, Any]:
    step = Calibrate.create(**selected(options, "model", "cells", "parameters", "quantum_mm"))
    content = step.run(options.out, tuple(options.residuals))
    if options.json:
        return content
    counts = content["provenance"]["counts"]
    return {"model": content["model"], **counts, **_lines(content)}


def _lines(content: dict[str, Any]) -> dict[str, Any]:
    intervals = content["intervals_95"]
    lines = {}
    for name, value in content["parameters"].items():
        if name != "bias_m":
            low, high = intervals.get(name, (None, None))
            interval = "" if low is None else f"  ({low:.6g} to {high:.6g})"
            lines[name] = f"{value}{interval}"
    for laser, value in enumerate(content["parameters"].get("bias_m", [])):
        low, high = intervals["bias_m"][laser]
        lines[f"bias of laser {laser}"] = f"{value:.5f}  ({low:.5f} to {high:.5f})"
    return lines

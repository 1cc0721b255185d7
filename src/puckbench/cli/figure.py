"""`puckbench figure`: draw a figure from the tables of a run."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from puckbench.cli.types import files_by_name, json_object
from puckbench.figures.plot_styles import read_looks
from puckbench.figures.registry import FIGURES
from puckbench.jobs.figure import Figure


def arguments(parser: argparse.ArgumentParser) -> None:
    names = ", ".join(FIGURES.names())
    parser.add_argument("figure", help=f"one of {names}, or path/to/file.py:function")
    parser.add_argument("out", type=Path, nargs="+", help="files to write (.pdf, .png)")
    parser.add_argument(
        "--inputs", type=json_object, required=True, help='JSON: {"metrics": "metrics.csv", ...}'
    )
    parser.add_argument(
        "--style", type=json.loads, default=[], help="JSON: one object of FigureStyle, or several"
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    layers = options.style if isinstance(options.style, list) else [options.style]
    inputs = files_by_name(options.inputs, "--inputs")
    looks = [read_looks(path.parent) for path in inputs.values()]
    job = Figure.given(figure=options.figure, style=(*filter(None, looks), *layers))
    return job.run(tuple(options.out), **inputs)

"""`puckbench train`: weights of a learned codec from clouds, resumable, measured on others."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import json_object, whole
from puckbench.core.models import parsed
from puckbench.jobs.train import Train
from puckbench.planning.config import CodecConfig


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("clouds", type=Path, nargs="+", help="prepared clouds to learn from (PLY)")
    parser.add_argument(
        "--out", type=Path, required=True, help="set of weights to write (.safetensors)"
    )
    parser.add_argument("--codec", default="pcgcv2_plus", help="default: %(default)s")
    parser.add_argument("--start", help="weights to start from: a shipped set's name, or a file")
    parser.add_argument("--steps", type=whole(1), help="of the training; default: the codec's")
    parser.add_argument("--seed", type=whole(0), help="default: 1")
    parser.add_argument(
        "--options", type=json_object, default={}, help="further settings of the codec's training"
    )
    parser.add_argument(
        "--entry", type=json_object, default={}, help="changes to the codec's entry, as in a config"
    )
    parser.add_argument("--every", type=whole(1), default=100, help="steps between two savings")
    parser.add_argument(
        "--validate", type=Path, nargs="+", default=[], help="clouds to measure the set on (PLY)"
    )
    parser.add_argument(
        "--validate-every",
        type=whole(0),
        default=0,
        help="steps between measurements (default: one at the end)",
    )
    parser.add_argument(
        "--peak", type=float, help="of the PSNRs (default: size - 1 of the validation's JSON)"
    )
    parser.add_argument(
        "--code", help="fingerprint of the code: begin anew where anything else made the checkpoint"
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Train, going on from the checkpoint beside `out` where there is one, and export the set."""
    given = {"steps": options.steps, "seed": options.seed}
    settings = {name: value for name, value in given.items() if value is not None}
    job = Train.given(
        codec=options.codec,
        changes=parsed(CodecConfig, options.entry, "--entry").changes(),
        options={**settings, **options.options},
        start=options.start,
        every=options.every,
        validate_every=options.validate_every,
        peak=options.peak,
        code=options.code,
    )
    return job.run(tuple(options.clouds), options.out, tuple(options.validate))

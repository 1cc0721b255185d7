from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import integer, json_object, selected
from puckbench.core.models import parsed
from puckbench.jobs.train import Train
from puckbench.planning.config import CodecConfig


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("clouds", type=Path, nargs="+", help="prepared training clouds (PLY)")
    parser.add_argument(
        "--out", type=Path, required=True, help="set of weights to write (.safetensors)"
    )
    parser.add_argument(
        "--codec", default="pcgcv2_plus", help="codec to train (default: %(default)s)"
    )
    parser.add_argument("--start", help="weights to start from: a shipped set's name, or a file")
    parser.add_argument(
        "--steps", type=integer(1), help="number of optimiser steps (default: the codec's)"
    )
    parser.add_argument("--seed", type=integer(0), help="seed of the training (default: 1)")
    parser.add_argument(
        "--options", type=json_object, default={}, help="further settings of the training (JSON)"
    )
    parser.add_argument(
        "--entry",
        type=json_object,
        default={},
        help="the codec's entry, as in a configuration (JSON)",
    )
    parser.add_argument(
        "--every", type=integer(1), default=100, help="steps between two checkpoints (default: 100)"
    )
    parser.add_argument(
        "--validate", type=Path, nargs="+", default=[], help="validation clouds (PLY)"
    )
    parser.add_argument(
        "--validate-every",
        type=integer(0),
        default=0,
        help="steps between two validations (default: one validation at the end)",
    )
    parser.add_argument(
        "--peak",
        type=float,
        help="peak of the PSNRs (default: size - 1, from the validation clouds' descriptions)",
    )
    parser.add_argument(
        "--code", help="fingerprint of the code: start again if the checkpoint has another one"
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Train a network and write its weights; continue from the checkpoint beside `out`, if any."""
    settings = {
        name: value
        for name, value in selected(options, "steps", "seed").items()
        if value is not None
    }
    job = Train.create(
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

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pointkit.errors import InputError
from puckbench.cli.codec_options import add_entry, entry_of
from puckbench.cli.types import integer, json_object, refuse, selected
from puckbench.steps.weights import Train


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("clouds", type=Path, nargs="+", help="prepared training clouds (PLY)")
    add("--out", type=Path, required=True, help="set of weights to write (.safetensors)")
    add("--codec", default="pcgcv2_plus", help="codec to train (default: %(default)s)")
    add("--start", help="weights to start from: a shipped set's name, or a file")
    add("--steps", type=integer(1), help="number of optimiser steps (default: the codec's)")
    add("--seed", type=integer(0), help="seed of the training (default: 1)")
    add("--options", type=json_object, default={}, help="further settings of the training (JSON)")
    add_entry(parser)
    add("--every", type=integer(1), default=100, help="steps between checkpoints (default: 100)")
    add("--validate", type=Path, nargs="+", default=[], help="validation clouds (PLY)")
    text = "steps between two validations (default: one validation at the end)"
    add("--validate-every", type=integer(0), default=0, help=text)
    text = "peak of the PSNRs (default: size - 1, from the validation clouds' descriptions)"
    add("--peak", type=float, help=text)
    add("--code", help="fingerprint of the code: start again if the checkpoint has another one")


def run(options: argparse.Namespace) -> dict[str, Any]:
    settings = {
        name: value
        for name, value in selected(options, "steps", "seed").items()
        if value is not None
    }
    for name in settings.keys() & options.options.keys():
        raise InputError(f"--{name}: --options has it, too")
    if not options.validate:
        refuse(options, {"validate_every": 0, "peak": None}, "only with --validate")
    step = Train.create(
        codec=options.codec,
        entry=entry_of(options),
        options={**settings, **options.options},
        **selected(options, "start", "every", "validate_every", "peak", "code"),
    )
    return step.run(tuple(options.clouds), options.out, tuple(options.validate))

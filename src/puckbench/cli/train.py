"""`puckbench train`: weights of a learned codec from clouds, resumable, measured on others."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.cli.codec_options import with_options
from puckbench.cli.types import json_object, whole
from puckbench.codecs.learned.catalogue import weights_file
from puckbench.codecs.learned.training.settings import Training, open_training
from puckbench.codecs.registry import entry, open_codec
from puckbench.core.files import sha256, write_json
from puckbench.io.clouds import read_cloud

if TYPE_CHECKING:
    from puckbench.codecs.learned.training.loop import Trainer


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
        "--validate-every", type=whole(0), default=0, help="measure it every so many steps too"
    )
    parser.add_argument("--peak", type=float, default=1023.0, help="of the PSNRs (default: 1023)")
    parser.add_argument(
        "--code", help="fingerprint of the code: begin anew where anything else made the checkpoint"
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Train, going on from the checkpoint beside `out` where there is one, and export the set."""
    from puckbench.codecs.learned.training.loop import train
    from puckbench.jobs.training_curve import Curve

    training = _training(options)
    checkpoint = options.out.with_suffix(".pt")
    with training.trainer() as trainer:
        _begin(trainer, training, options)
        _resume(trainer, checkpoint, options)
        examples = training.examples([read_cloud(path).xyz for path in options.clouds])
        curve = Curve(trainer, options.out.with_suffix(".csv"), options.every)

        def report(step: int, loss: Any) -> None:
            curve.note(step, loss)
            if options.validate_every and step % options.validate_every == 0:
                _measure_now(options, training, trainer)

        train(trainer, examples.batch, checkpoint, options.every, report)
        curve.write()
    return _export(options, training, trainer, curve.seconds)


def _training(options: argparse.Namespace) -> Training:
    given = {"steps": options.steps, "seed": options.seed}
    settings = {name: value for name, value in given.items() if value is not None}
    return open_training(options.codec, options.entry, {**settings, **options.options})


def _begin(trainer: Trainer[Any, Any], training: Training, options: argparse.Namespace) -> None:
    """Start from weights, if asked to, and note what the training is one of."""
    trainer.identity = {"data": [sha256(path) for path in options.clouds]}
    if options.code is not None:
        trainer.identity["code"] = options.code
    if options.start is not None:
        start = weights_file(options.start)
        training.begin(trainer.model, start)
        trainer.identity["start"] = sha256(start)


def _resume(trainer: Trainer[Any, Any], checkpoint: Path, options: argparse.Namespace) -> None:
    """Go on from the checkpoint; with a fingerprint of the code, remove any other training's."""
    from puckbench.codecs.learned.training.loop import OtherTrainingError

    if checkpoint.exists():
        try:
            trainer.resume(checkpoint)
        except OtherTrainingError:
            if options.code is None:
                raise
            checkpoint.unlink()
        else:
            print(f"{checkpoint}: going on after step {trainer.done}", file=sys.stderr)  # noqa: T201


def _export(
    options: argparse.Namespace, training: Training, trainer: Trainer[Any, Any], seconds: float
) -> dict[str, Any]:
    """Write the set, and again with what it was measured to be; the card stands beside it too."""
    card = {
        "codec": options.codec,
        **training.model_dump(),
        "data": _names(options.clouds),
        **({"start": Path(options.start).stem} if options.start else {}),
        "seconds": seconds,
    }
    training.export(options.out, trainer.model, card)
    if options.validate:
        card["validation"] = _measured(options, training, options.out)
        training.export(options.out, trainer.model, card)
    write_json(options.out.with_suffix(".json"), card)
    return card


def _measured(options: argparse.Namespace, training: Training, weights: Path) -> dict[str, Any]:
    """What the codec does with a set on the validation's clouds; a warning where it is at fault."""
    from puckbench.codecs.learned.training.validation import validation

    changes = with_options(options.entry, weights=str(weights))
    rates = training.rates(entry(options.codec, changes)["rates"])
    codec = open_codec(options.codec, {**changes, "rates": rates})
    found = validation(codec, options.validate, options.peak)
    for fault in found["faults"]:
        print(f"warning: {options.out.stem}: {fault}", file=sys.stderr)  # noqa: T201
    return {"data": _names(options.validate), **found}


def _measure_now(
    options: argparse.Namespace, training: Training, trainer: Trainer[Any, Any]
) -> None:
    """Tell what the set would do if the training ended here."""
    weights = options.out.with_name(f".{options.out.name}")
    training.export(weights, trainer.model, {})
    for rate, means in _measured(options, training, weights)["rates"].items():
        values = ", ".join(f"{name} {value:.4g}" for name, value in means.items())
        print(f"step {trainer.done}, {rate}: {values}", file=sys.stderr)  # noqa: T201
    weights.unlink()


def _names(paths: Sequence[Path]) -> list[str]:
    """Clouds by their paths below the folder that all of them are in."""
    shared = os.path.commonpath([path.parent.resolve() for path in paths])
    return sorted(path.resolve().relative_to(shared).as_posix() for path in paths)

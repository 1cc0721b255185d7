from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pointkit.errors import naming
from pointkit.files import write_json
from puckbench.cli.codec_options import codec_arguments, decoder_of
from puckbench.cli.types import refuse
from puckbench.results.curves import read_coded
from puckbench.steps.recovery import labelled_points, recovered


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("stream", type=Path, help="stream of a codec that codes surfaces")
    add("points", type=Path, help="true points with labels (prepare --truth)")
    add("scene", type=Path, help="labelled mesh of the scene (.ply), in metres")
    add("--dataset", help="name of the data set, for the result row")
    add("--row", type=Path, help="write the result row here (JSON)")
    add("--rate", help="rate of a curve (coded/DATASET/CLOUD/CODEC.zip)")
    codec_arguments(parser, required=False)


def run(options: argparse.Namespace) -> dict[str, Any]:
    refuse(options, {"repeats": 1}, "recovery is not timed")
    truth = labelled_points(options.points, options.scene)
    named = {"dataset": options.dataset} if options.dataset else {}
    with naming(options.stream):
        coded = read_coded(options.stream, options.rate)
        row = {**named, "cloud": options.points.stem}
        row |= recovered(truth, decoder_of(options, coded), coded)
    if options.row:
        write_json(options.row, row)
    if row["kinds"] or options.json:
        return row
    return {**row, "kinds": "none: this stream has no surface, only points (try another rate)"}

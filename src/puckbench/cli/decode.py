from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.codec_options import codec_arguments, timed_options
from puckbench.cli.types import refuse
from puckbench.jobs.decode import Decode


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("stream", type=Path, help="stream to decode")
    add("out", type=Path, help="PLY file to write (LAS or LAZ if --like names such a file)")
    text = "write the surface instead of points, if the stream has one"
    add("--as-mesh", action="store_true", help=text)
    text = (
        "the prepared cloud that was coded (.ply): write the points in metres, where its source "
        "was; or the original cloud (LAS, PLY, PCD, E57, ...): write its header and attributes "
        "too, matched by order or position; or both (--like twice)"
    )
    add("--like", type=Path, action="append", default=[], metavar="CLOUD", help=text)
    add("--rate", help="rate to decode of a curve (coded/DATASET/CLOUD/CODEC.zip)")
    codec_arguments(parser, required=False)


def run(options: argparse.Namespace) -> dict[str, Any]:
    if options.as_mesh:
        refuse(options, {"repeats": 1}, "not with --as-mesh, which is not timed")
    job = Decode.create(as_mesh=options.as_mesh, rate=options.rate, **timed_options(options))
    return job.run(options.stream, options.out, tuple(options.like))

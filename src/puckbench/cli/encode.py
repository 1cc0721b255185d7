from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.codec_options import codec_arguments, timed_options
from puckbench.jobs.codec_jobs import with_options
from puckbench.jobs.encode import Encode


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("cloud", type=Path, help="cloud to code (PLY, PCD, LAS, ...)")
    add("out", type=Path, help="stream to write; its record (JSON) is written beside it")
    text = "r1 (smallest bitrate), r2, ...; for clouds in metres any length such as 3mm"
    add("--rate", required=True, help=text)
    text = "G-PCC: write a bare stream, as the reference software does"
    add("--raw", action="store_true", help=text)
    text = (
        "coordinate frame of a cloud without a description (.json) beside it (default: metric for "
        "LAS, LAZ, E57 and .bin)"
    )
    add("--frame", choices=["scaled", "metric"], help=text)
    text = (
        "first prepare the cloud and write it to this file: in metres if the rate is a length, "
        "else scaled (or as --frame says)"
    )
    add("--prepare", type=Path, metavar="PLY", help=text)
    codec_arguments(parser, required=True)


def run(options: argparse.Namespace) -> dict[str, Any]:
    settings = timed_options(options)
    if options.raw:
        settings["changes"] = with_options(settings["changes"], raw=True)
    job = Encode.create(rate=options.rate, frame=options.frame, **settings)
    return job.run(options.cloud, options.out, options.prepare)

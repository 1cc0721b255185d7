"""`puckbench encode`: code a cloud with a codec at a rate, and say what it cost."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.codec_options import codec_arguments, timed_options
from puckbench.jobs.codecs import with_options
from puckbench.jobs.encode import Encode


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("cloud", type=Path, help="cloud to code (PLY, PCD, LAS, ...)")
    parser.add_argument("out", type=Path, help="stream to write; what it cost goes beside it")
    parser.add_argument(
        "--rate",
        required=True,
        help="r1 is the smallest bitrate; of clouds in metres a length, 10mm",
    )
    parser.add_argument(
        "--raw", action="store_true", help="G-PCC: a bare stream, as the reference software's"
    )
    parser.add_argument(
        "--frame", choices=["scaled", "metric"], help="of a cloud without a description beside it"
    )
    parser.add_argument(
        "--prepare", type=Path, metavar="PLY", help="prepare the cloud, write it here and code it"
    )
    codec_arguments(parser, required=True)


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Write the stream and its record."""
    chosen = timed_options(options)
    if options.raw:
        chosen["changes"] = with_options(chosen["changes"], raw=True)
    job = Encode.given(rate=options.rate, frame=options.frame, **chosen)
    return job.run(options.cloud, options.out, options.prepare)

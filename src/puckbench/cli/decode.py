"""`puckbench decode`: points from a stream; the codec is found from the stream itself."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.codec_options import codec_arguments, timed_options
from puckbench.jobs.decode import Decode


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("stream", type=Path, help="stream to decode")
    parser.add_argument("out", type=Path, help="PLY file to write")
    parser.add_argument("--as-mesh", action="store_true", help="write the surface, if it has one")
    parser.add_argument("--rate", help="of a curve (coded/DATASET/CLOUD/CODEC.zip)")
    codec_arguments(parser, required=False)


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Write the decoded cloud, or the surface that a codec of surfaces has coded."""
    job = Decode.given(as_mesh=options.as_mesh, rate=options.rate, **timed_options(options))
    return job.run(options.stream, options.out)

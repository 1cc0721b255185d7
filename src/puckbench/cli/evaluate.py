"""`puckbench evaluate`: distortion of a decoded cloud, or of a coded stream, and what it cost."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from puckbench.cli.codec_options import codec_arguments, timed_options
from puckbench.cli.types import chosen, tell, whole
from puckbench.jobs.evaluate import Evaluate

_UNLIKE_DB = 10.0
"""CD-PSNR of a decoded cloud below which it is hardly the reference's: no codec is that far off."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("reference", type=Path, help="reference cloud (PLY, PCD, LAS, ...)")
    parser.add_argument("decoded", type=Path, help="decoded cloud (but .bin) or stream to decode")
    parser.add_argument(
        "--truth",
        type=Path,
        help="true surface: mesh or captured room in metres, or cloud in the reference's frame",
    )
    parser.add_argument(
        "--visible", type=Path, help="points seen of the true surface, in the reference's frame"
    )
    parser.add_argument(
        "--clean", type=Path, help="clean scan of the same rays, instead of --visible"
    )
    parser.add_argument(
        "--peak",
        type=float,
        help="of the PSNRs, in the reference's unit (default: its own, 1023 if scaled, 30 if in "
        "metres; papers on KITTI take 59.7)",
    )
    parser.add_argument(
        "--views", type=whole(0), default=0, help="pixels of six pictures to compare (default: 0)"
    )
    parser.add_argument("--dataset", help="name of the data set, for the result row")
    parser.add_argument("--row", type=Path, help="write the result row here (JSON)")
    parser.add_argument("--rate", help="of a curve (coded/DATASET/CLOUD/CODEC.zip)")
    codec_arguments(parser, required=False)


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Measure; the answer is the result row."""
    settings = chosen(options, "dataset", "peak", "views", "rate")
    job = Evaluate.given(**settings, **timed_options(options))
    files = chosen(options, "row", "truth", "visible", "clean")
    row = job.run(options.reference, options.decoded, **files)
    if not row["lossless"] and "d1_psnr" not in row:
        tell(f"{options.reference}: no size in a description beside it: no d1_psnr without --peak")
    if row.get("cd_psnr_point", math.inf) < _UNLIKE_DB:
        tell(f"{options.reference}, {options.decoded}: far apart: are both in one frame?")
    return row

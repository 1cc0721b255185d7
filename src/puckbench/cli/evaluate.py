from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from cloud_files.clouds import SUFFIXES, read_cloud
from cloud_files.content import plain_suffix
from pointkit.errors import naming
from pointkit.files import write_json
from pointkit.models import parsed
from puckbench.cli.codec_options import codec_arguments, decoder_of, timing_of
from puckbench.cli.types import integer, note, refuse, selected
from puckbench.results.curves import read_coded
from puckbench.steps.coding import Decoded, decoded_cloud
from puckbench.steps.evaluate import Measuring, Originals

_FOR_STREAMS: dict[str, Any] = {
    "codec": None,
    "weights": None,
    "entry": {},
    "repeats": 1,
    "rate": None,
}
"""Options that apply only to coded streams, not to decoded clouds, with their defaults."""
_UNRELATED_DB = 10.0
"""CD-PSNR, in dB, below which two clouds are probably unrelated; every codec exceeds it."""


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("reference", type=Path, help="reference cloud (PLY, PCD, LAS, ...)")
    add("decoded", type=Path, help="decoded cloud (not .bin), or stream to decode")
    text = "true surface: mesh or captured room in metres, or cloud in the reference's frame"
    add("--truth", type=Path, help=text)
    text = "points of the true surface that the sensor saw, in the reference's frame"
    add("--visible", type=Path, help=text)
    add("--clean", type=Path, help="clean scan of the same rays, in place of --visible")
    text = (
        "peak of the PSNRs, in the reference's unit (default: from its description, else 1023 if "
        "scaled, 30 if in metres; papers on KITTI use 59.7)"
    )
    add("--peak", type=float, help=text)
    text = "width in pixels of six rendered views to compare (default: 0, none)"
    add("--views", type=integer(0), default=0, help=text)
    add("--dataset", help="name of the data set, for the result row")
    add("--row", type=Path, help="write the result row here (JSON)")
    add("--rate", help="rate of a curve (coded/DATASET/CLOUD/CODEC.zip)")
    codec_arguments(parser, required=False)


def run(options: argparse.Namespace) -> dict[str, Any]:
    if is_decoded(options.decoded):
        why = f"is for streams, and {options.decoded} is a decoded cloud"
        refuse(options, _FOR_STREAMS, why)
    if options.clean:
        refuse(options, {"visible": None}, "not with --clean, which replaces it")
    measuring = parsed(Measuring, selected(options, "dataset", "peak", "views"), "evaluate")
    originals = Originals(options.reference, **selected(options, "truth", "visible", "clean"))
    row = measuring.row(originals, _decoded(options))
    if options.row:
        write_json(options.row, row)
    if not row["lossless"] and "d1_psnr" not in row:
        note(f"{options.reference}: no size in a description beside it: d1_psnr needs --peak")
    if row.get("cd_psnr_point", math.inf) < _UNRELATED_DB:
        note(f"{options.reference}, {options.decoded}: far apart: are both in the same frame?")
    return row


def is_decoded(path: Path) -> bool:
    """Return whether a file is a decoded cloud, and not a stream, as its suffix tells."""
    return plain_suffix(path) in SUFFIXES and plain_suffix(path) != ".bin"


def _decoded(options: argparse.Namespace) -> Decoded:
    path = options.decoded
    if is_decoded(path):
        return Decoded(read_cloud(path), {})
    with naming(path):
        coded = read_coded(path, options.rate)
        return decoded_cloud(decoder_of(options, coded), coded, timing_of(options))

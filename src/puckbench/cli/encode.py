from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pointkit.errors import naming
from pointkit.files import write_json, written_whole
from pointkit.geometry.cloud import CoordinateFrame, PointCloud
from puckbench.cli.codec_options import codec_arguments, opened_codec, timing_of
from puckbench.cli.types import note
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.coding import check_codes
from puckbench.codecs.rates import is_length, rate_name
from puckbench.geometry.attributes import RETURNS
from puckbench.results.curves import record_file
from puckbench.steps.coding import ready
from puckbench.steps.encode import coded_cloud, to_code


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
    timing = timing_of(options)
    codec = opened_codec(options, **({"raw": True} if options.raw else {}))
    with naming("--rate"):
        rate = rate_name(codec, options.rate)
    original = _cloud(options, codec, rate)
    if RETURNS in codec.attributes and original.returns is None:
        why = f"no returns, so codec {codec.name} does without its sensor"
        note(f"{options.prepare or options.cloud}: {why}")
    coded = coded_cloud(ready(codec), original, rate, timing)
    with written_whole(options.out) as temporary:
        temporary.write_bytes(coded.stream)
        write_json(record_file(options.out), coded.record)
    return coded.record


def _cloud(options: argparse.Namespace, codec: Codec, rate: str) -> PointCloud:
    if options.prepare:
        of_rate: CoordinateFrame = "metric" if is_length(codec, rate) else "scaled"
        frame = options.frame or of_rate
        check_codes(codec, CloudKind(frame, True, True), rate)
        _prepare(options.cloud, options.prepare, in_metres=frame == "metric")
    return to_code(codec, options.prepare or options.cloud, options.frame, rate)


def _prepare(source: Path, cloud: Path, in_metres: bool) -> None:
    from puckbench.steps.prepare import Prepare, measured_points

    step = Prepare(size="metric") if in_metres else Prepare()
    step.write(source, measured_points(source), {}, cloud)

"""`puckbench encode`: code a cloud with a codec at a rate, and say what it cost."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.codec_options import chosen_codec, codec_arguments, with_options
from puckbench.codecs.measurement import measured
from puckbench.core.environment import cpu_model, run_environment
from puckbench.core.files import write_json, written_whole
from puckbench.io.clouds import read_cloud


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("cloud", type=Path, help="cloud to code (.ply)")
    parser.add_argument("out", type=Path, help="stream to write; what it cost goes beside it")
    parser.add_argument("--rate", required=True, help="r1 is the smallest bitrate")
    parser.add_argument(
        "--raw", action="store_true", help="G-PCC: a bare stream, as the reference software's"
    )
    codec_arguments(parser, required=True)


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Write the stream and its record."""
    if options.raw:
        options.entry = with_options(options.entry, raw=True)
    codec = chosen_codec(options, options.codec)
    points = read_cloud(options.cloud).xyz
    coded = measured(lambda: codec.encode(points, options.rate), options.repeats, codec.cost)
    weights = codec.weights_of(options.rate)
    record = {
        "codec": options.codec,
        "rate": options.rate,
        "codec_version": codec.version,
        **({"weights": weights} if weights else {}),
        "points_in": len(points),
        "bytes": len(coded.result),
        "bpp": 8 * len(coded.result) / len(points),
        "repeats": options.repeats,
        **coded.costs("encode"),
        **run_environment(options.alone),
        "encode_cpu": cpu_model(),  # decoding may be done, and recorded, elsewhere
    }
    with written_whole(options.out) as temporary:
        temporary.write_bytes(coded.result)
        write_json(record_file(options.out), record)
    return record


def record_file(stream: Path) -> Path:
    """The JSON file that says what a stream cost; not that of a cloud of the same name."""
    return stream.with_name(f"{stream.name}.json")

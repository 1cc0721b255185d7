"""`puckbench decode`: points from a stream; the codec is found from the stream itself."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, NamedTuple

from puckbench.cli.codec_options import chosen_codec, codec_arguments
from puckbench.cloud import Floats, PointCloud, write_cloud
from puckbench.codecs.measure import measured
from puckbench.codecs.registry import codec_of
from puckbench.errors import InputError
from puckbench.files import read_bytes


class Decoded(NamedTuple):
    """Decoded points (m, 3) and what decoding cost."""

    points: Floats
    record: dict[str, Any]


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("stream", type=Path, help="stream to decode")
    parser.add_argument("out", type=Path, help="PLY file to write")
    codec_arguments(parser, required=False)


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Write the decoded cloud."""
    decoded = decode_file(options.stream, options)
    about = {"source": options.stream.name, "codec": decoded.record["codec"]}
    write_cloud(options.out, PointCloud(decoded.points, about=about))
    return decoded.record


def decode_file(path: Path, options: argparse.Namespace) -> Decoded:
    """Decode a stream file, timed; InputError names the file when it is damaged or foreign."""
    stream = read_bytes(path)
    try:
        name = options.codec or codec_of(stream)
        codec = chosen_codec(options, name)
        timed = measured(lambda: codec.decode(stream), options.repeats, codec.cost)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    record = {
        "codec": name,
        "bytes": len(stream),
        "points_out": len(timed.result),
        "decode_s": timed.seconds,
        "decode_peak_mib": timed.peak_mib,
    }
    return Decoded(timed.result, record)

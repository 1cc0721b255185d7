"""`puckbench decode`: points from a stream; the codec is found from the stream itself."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, NamedTuple

from puckbench.cli.codec_options import chosen_codec, codec_arguments
from puckbench.codecs.measurement import measured
from puckbench.codecs.registry import codec_of
from puckbench.core.environment import run_environment
from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.io.clouds import write_cloud
from puckbench.io.meshes.writing import write_mesh


class Decoded(NamedTuple):
    """Decoded points (m, 3) and what decoding cost."""

    points: Floats
    record: dict[str, Any]


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("stream", type=Path, help="stream to decode")
    parser.add_argument("out", type=Path, help="PLY file to write")
    parser.add_argument("--as-mesh", action="store_true", help="write the surface, if it has one")
    codec_arguments(parser, required=False)


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Write the decoded cloud, or the surface that a codec of surfaces has coded."""
    if options.as_mesh:
        return _run_mesh(options)
    decoded = decode_file(options.stream, options)
    about = {"source": options.stream.name, "codec": decoded.record["codec"]}
    write_cloud(options.out, PointCloud(decoded.points, about=about))
    return decoded.record


def _run_mesh(options: argparse.Namespace) -> dict[str, Any]:
    stream = read_bytes(options.stream)
    try:
        name = options.codec or codec_of(stream)
        mesh = chosen_codec(options, name).decode_mesh(stream)
    except InputError as error:
        raise InputError(f"{options.stream}: {error}") from error
    write_mesh(options.out, mesh, {"source": options.stream.name, "codec": name})
    return {
        "codec": name,
        "bytes": len(stream),
        "vertices": len(mesh.vertices),
        "triangles": len(mesh.triangles),
        "primitives": len(mesh.labels.primitives) if mesh.labels else 0,
    }


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
        **timed.costs("decode"),
        **run_environment(options.alone),
    }
    return Decoded(timed.result, record)

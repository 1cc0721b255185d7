from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pointkit.geometry.cloud import Floats

TOOLS = ("octree", "angular octree", "trees", "angular trees", "attributes")


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    text = (
        "a codec (gpcc), the path of tmc3, or a command in which {stream} and {points} stand for "
        "the stream and the PLY file to write"
    )
    add("decoder", help=text)
    add("--streams", type=Path, help="folder of streams with a manifest.json (default: ours)")
    add("--tools", choices=TOOLS, action="append", help="only streams with these coding tools")


def points_decoder(codec: str) -> Callable[[bytes], Floats]:
    """Return a function that decodes a stream to points (m, 3); `codec` is the codec's name."""
    from puckbench.codecs.coding import decoded
    from puckbench.codecs.registry import open_codec

    opened = open_codec(codec)
    return lambda stream: decoded(opened, stream).xyz


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Decode conformance streams with a G-PCC decoder.

    The answer has the numbers of streams that were decoded, refused and failed, and a row for each
    refused or failed stream; with ``--json``, a row for every stream.
    """
    from gpcc.conformance import (
        FOLDER,
        Decode,
        conformance_streams,
        decode_rows,
        verdicts,
    )
    from puckbench.cli.decoding_program import program_decoder
    from puckbench.codecs.registry import codecs

    streams = conformance_streams(options.streams or FOLDER)
    selected = [stream for stream in streams if not options.tools or stream.tools in options.tools]
    name = options.decoder
    if name == "gpcc":  # the codec gives points, the engine attributes, too
        decode: Decode = decode_rows
    else:
        decode = points_decoder(name) if name in codecs() else program_decoder(name)
    results = list(verdicts(decode, selected))
    counts = {
        outcome: sum(verdict.outcome == outcome for verdict in results)
        for outcome in ("decoded", "refused", "failed")
    }
    rows = {
        verdict.stream.name: {
            "tools": verdict.stream.tools,
            "outcome": verdict.outcome,
            "why": verdict.why,
        }
        for verdict in results
        if options.json or verdict.outcome != "decoded"
    }
    return {"streams": len(results), **counts, **({"not decoded": rows} if rows else {})}

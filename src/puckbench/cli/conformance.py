"""`puckbench conformance`: which of the stored G-PCC streams a decoder decodes correctly."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

TOOLS = ("octree", "angular octree", "trees", "angular trees")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "decoder",
        help="a codec (gpcc), the path of tmc3, or a command with {stream} and {points} (.ply)",
    )
    parser.add_argument("--streams", type=Path, help="folder of other streams with a manifest.json")
    parser.add_argument("--tools", choices=TOOLS, action="append", help="only streams with these")


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Decode every stream; count those decoded, refused and failed, and list the last two."""
    from puckbench.codecs.registry import codecs, open_codec
    from puckbench.gpcc.conformance import FOLDER, conformance_streams, program_decoder, verdicts

    streams = conformance_streams(options.streams or FOLDER)
    chosen = [stream for stream in streams if not options.tools or stream.tools in options.tools]
    known = options.decoder in codecs()
    decode = open_codec(options.decoder).decode if known else program_decoder(options.decoder)
    found = list(verdicts(decode, chosen))
    counts = {
        outcome: sum(verdict.outcome == outcome for verdict in found)
        for outcome in ("decoded", "refused", "failed")
    }
    rows = {
        verdict.stream.name: {
            "tools": verdict.stream.tools,
            "outcome": verdict.outcome,
            "why": verdict.why,
        }
        for verdict in found
        if options.json or verdict.outcome != "decoded"
    }
    return {"streams": len(found), **counts, **({"not decoded": rows} if rows else {})}

"""Arguments that name a codec: --codec, --weights, and --entry for a codec's configured changes."""

from __future__ import annotations

import argparse
from typing import Any

from puckbench.cli.types import json_object
from puckbench.core.models import parsed
from puckbench.jobs.codecs import with_options
from puckbench.planning.config import CodecConfig


def codec_arguments(parser: argparse.ArgumentParser, required: bool) -> None:
    """Declare --codec, --weights, --entry, --repeats and --alone."""
    parser.add_argument("--codec", required=required, help="see `puckbench codecs`")
    parser.add_argument(
        "--weights", help="a learned codec's: a shipped set, a file or a folder of weights"
    )
    parser.add_argument(
        "--entry", type=json_object, default={}, help="changes to the codec's entry, as in a config"
    )
    parser.add_argument("--repeats", type=int, default=1, help="timed calls; the median counts")
    parser.add_argument(
        "--alone", action="store_true", help="say in the record that nothing else ran meanwhile"
    )


def codec_options(options: argparse.Namespace) -> dict[str, Any]:
    """Fields of `puckbench.jobs.codecs.CodecJob`."""
    changes = parsed(CodecConfig, options.entry, "--entry").changes()
    if options.weights:
        changes = with_options(changes, weights=options.weights)
    return {"codec": options.codec, "changes": changes}


def timed_options(options: argparse.Namespace) -> dict[str, Any]:
    """Fields of `puckbench.jobs.codecs.TimedJob`."""
    return {**codec_options(options), "repeats": options.repeats, "alone": options.alone}

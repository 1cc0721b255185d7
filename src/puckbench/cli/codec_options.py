from __future__ import annotations

import argparse
from typing import Any

from puckbench.cli.types import json_object
from puckbench.core.models import parsed
from puckbench.jobs.codec_jobs import with_options
from puckbench.planning.config import CodecConfig


def codec_arguments(parser: argparse.ArgumentParser, required: bool) -> None:
    parser.add_argument("--codec", required=required, help="name (see `puckbench codecs`)")
    parser.add_argument(
        "--weights", help="weights of a learned codec: a shipped set, a file or a folder"
    )
    parser.add_argument(
        "--entry",
        type=json_object,
        default={},
        help="the codec's entry, as in a configuration (JSON)",
    )
    parser.add_argument(
        "--repeats",
        type=int,
        default=1,
        help="number of timed calls, of which the median is recorded",
    )
    parser.add_argument(
        "--alone", action="store_true", help="record that nothing else ran during the calls"
    )


def codec_options(options: argparse.Namespace) -> dict[str, Any]:
    changes = parsed(CodecConfig, options.entry, "--entry").changes()
    if options.weights:
        changes = with_options(changes, weights=options.weights)
    return {"codec": options.codec, "changes": changes}


def timed_options(options: argparse.Namespace) -> dict[str, Any]:
    return {**codec_options(options), "repeats": options.repeats, "alone": options.alone}

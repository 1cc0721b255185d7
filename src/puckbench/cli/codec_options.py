from __future__ import annotations

import argparse
from typing import Any

from pointkit.models import parsed
from puckbench.cli.types import json_object
from puckbench.jobs.codec_jobs import with_options
from puckbench.planning.config import CodecConfig


def codec_arguments(parser: argparse.ArgumentParser, required: bool) -> None:
    """Add the options that choose a codec and say how often it is timed.

    Parameters
    ----------
    parser
        Parser of a command.
    required
        Whether the command needs ``--codec``.
    """
    add = parser.add_argument
    add("--codec", required=required, help="name (see `puckbench codecs`)")
    add("--weights", help="weights of a learned codec: a shipped set, a file or a folder")
    add_entry(parser)
    text = "number of timed calls, of which the median is recorded (default: 1)"
    add("--repeats", type=int, default=1, help=text)


def add_entry(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--entry``, with which the user changes a codec's defaults."""
    text = "the codec's entry, as in a configuration (JSON)"
    parser.add_argument("--entry", type=json_object, default={}, help=text)


def entry_of(options: argparse.Namespace) -> dict[str, Any]:
    """Return the changes to a codec's defaults that the option ``--entry`` makes."""
    return parsed(CodecConfig, options.entry, "--entry").changes()


def codec_options(options: argparse.Namespace) -> dict[str, Any]:
    """Return the codec's name and the changes to its defaults, as keywords of a job."""
    changes = entry_of(options)
    if options.weights:
        changes = with_options(changes, weights=options.weights)
    return {"codec": options.codec, "changes": changes}


def timed_options(options: argparse.Namespace) -> dict[str, Any]:
    """Return the codec, the changes to it, and the number of timed calls, as keywords of a job."""
    return {**codec_options(options), "repeats": options.repeats}

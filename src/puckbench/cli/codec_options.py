"""Arguments that name a codec: --codec, --weights, and --entry for a codec's configured changes."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from puckbench.cli.types import json_object
from puckbench.codecs.base import Codec
from puckbench.codecs.registry import open_codec
from puckbench.core.errors import InputError


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


def chosen_codec(options: argparse.Namespace, name: str) -> Codec:
    """The codec, loaded; InputError when it is unknown or cannot run here."""
    entry = options.entry
    if options.weights:
        entry = with_options(entry, weights=options.weights)
    codec = open_codec(name, entry)
    ok, why = codec.available()
    if not ok:
        raise InputError(f"codec {name} cannot run here: {why}")
    codec.load()
    return codec


def with_options(entry: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    """The changes to a codec's entry with further options."""
    return {**entry, "options": {**entry.get("options", {}), **more}}

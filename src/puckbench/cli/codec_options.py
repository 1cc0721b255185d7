from __future__ import annotations

import argparse
from typing import Any

from pointkit.errors import InputError
from pointkit.models import parsed
from pointkit.registry import is_place, trust
from puckbench.cli.types import json_object
from puckbench.codecs.base import Codec
from puckbench.codecs.registry import codec_of, is_codec, open_codec
from puckbench.planning.config import CodecConfig
from puckbench.results.curves import Coded
from puckbench.steps.coding import TimingSettings, codec_plugins, ready, with_options


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


def timing_of(options: argparse.Namespace) -> TimingSettings:
    """Return how the user wants calls to be timed."""
    return parsed(TimingSettings, {"repeats": options.repeats}, "--repeats")


def opened_codec(options: argparse.Namespace, **more: Any) -> Codec:
    """Return the codec of the option ``--codec``, with the changes that the user makes.

    `more` are further options of the codec.
    """
    return _opened(options.codec, options, more)


def decoder_of(options: argparse.Namespace, coded: Coded) -> Codec:
    """Return the codec that decodes a stream, ready to do so.

    It is the codec of the option ``--codec``. Without the option, it is the codec that the first
    bytes of the stream identify, or finally the codec named in the stream's record.

    Raises
    ------
    InputError
        None of these names a codec, the codec in the record is not registered, or the codec cannot
        run here.
    """
    return ready(_opened(options.codec or _name_of(options, coded), options, {}))


def _opened(name: str, options: argparse.Namespace, more: dict[str, Any]) -> Codec:
    weights = {"weights": options.weights} if options.weights else {}
    entry = entry_of(options)
    if weights or more:
        entry = with_options(entry, **weights, **more)
    trust(codec_plugins(options.codec, entry))  # not places that a stream's record names
    return open_codec(name, entry)


def _name_of(options: argparse.Namespace, coded: Coded) -> str:
    try:
        return codec_of(coded.stream)
    except InputError:
        if "codec" not in coded.record:
            raise
        name = str(coded.record["codec"])
    if not is_codec(name) and "class" not in options.entry:
        code = repr(name) if is_place(name) else "path/to/file.py:Class"
        raise InputError(f"codec {name!r} is not registered: name its code with --codec {code}")
    return name

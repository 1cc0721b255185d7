"""The commands ``compress`` and ``decompress`` of ``python -m puck`` and of ``puckbench``."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path
from typing import Any

from puck.options import EFFORTS

_LOG = logging.getLogger(__name__)


def add_compress_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command ``compress`` to `parser`; `run_compress` reads them."""
    add = parser.add_argument
    add("recording", type=Path, help="packet capture or bag (any file)")
    add("out", type=Path, help="file to write (.puck)")
    add("--effort", choices=EFFORTS, default="normal", help="speed against size (default: normal)")
    text = (
        "number of turns from one key turn, which can be decoded alone, to the next (default: 50); "
        "0: only the first turn is a key turn"
    )
    add("--key-every", type=_integer, default=50, metavar="TURNS", help=text)


def add_decompress_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command ``decompress`` to `parser`; `run_decompress` reads them."""
    add = parser.add_argument
    add("stream", type=Path, help="file that `compress` wrote (.puck)")
    add("out", type=Path, help="recording to write")
    text = "do not limit the size of the recording in proportion to that of the file"
    add("--trusted", action="store_true", help=text)


def _integer(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"'{text}' is not an integer of at least 0")
    return int(text)


def run_compress(options: argparse.Namespace) -> dict[str, Any]:
    """Compress the recording that the parsed arguments `options` name.

    Returns
    -------
    dict
        Counts and sizes in bytes by name, as the command prints them.
    """
    from pointkit.terminal import Progress
    from puck.options import CodingOptions
    from puck.recording import compress

    coding = CodingOptions(effort=options.effort, key_every=options.key_every)
    summary = compress(options.recording, options.out, coding, Progress("byte"))
    if not summary.packets:
        _LOG.warning(
            "%s: no data packets of a modelled sensor: LZMA alone (Ouster's need the sensor's "
            ".json beside the recording, or its metadata in the bag); decompress bags first "
            "(rosbag decompress, mcap decompress)",
            options.recording,
        )
    return summary.as_json()


def run_decompress(options: argparse.Namespace) -> dict[str, Any]:
    """Restore the recording that the parsed arguments `options` name.

    Returns
    -------
    dict
        Counts and sizes in bytes by name, as the command prints them.
    """
    from pointkit.terminal import Progress
    from puck.recording import decompress

    summary = decompress(options.stream, options.out, Progress("byte"), trusted=options.trusted)
    return summary.as_json()

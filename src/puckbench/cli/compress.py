from __future__ import annotations

import argparse
import logging
from pathlib import Path
from typing import Any

_LOG = logging.getLogger(__name__)


def arguments(parser: argparse.ArgumentParser) -> None:
    from puck.options import EFFORTS
    from puckbench.cli.types import integer

    add = parser.add_argument
    add("recording", type=Path, help="packet capture or bag (any file)")
    add("out", type=Path, help="file to write (.puck)")
    add("--effort", choices=EFFORTS, default="normal", help="speed against size (default: normal)")
    text = (
        "number of turns from one key turn, which can be decoded alone, to the next (default: 50); "
        "0: only the first turn is a key turn"
    )
    add("--key-every", type=integer(0), default=50, metavar="TURNS", help=text)


def run(options: argparse.Namespace) -> dict[str, Any]:
    from puck import CodingOptions, compress
    from puckbench.core.progress import Progress

    coding = CodingOptions(effort=options.effort, key_every=options.key_every)
    summary = compress(options.recording, options.out, coding, Progress("byte"))
    if not summary.packets:
        _LOG.warning(
            "%s: no data packets of a modelled sensor: LZMA alone (Ouster's need the sensor's "
            ".json beside the capture); decompress bags first (rosbag decompress, mcap decompress)",
            options.recording,
        )
    return summary.as_json()

from __future__ import annotations

import argparse
import logging
from pathlib import Path
from typing import Any

_LOG = logging.getLogger(__name__)


def arguments(parser: argparse.ArgumentParser) -> None:
    from puckbench.cli.types import integer
    from puckbench.puck.options import EFFORTS

    add = parser.add_argument
    add("recording", type=Path, help="packet capture or bag (any file)")
    add("out", type=Path, help="file to write (.puck)")
    add("--effort", choices=EFFORTS, default="normal", help="speed against size")
    text = "turns between two that can be decoded alone; 0: only the first can"
    add("--key-every", type=integer(0), default=50, metavar="TURNS", help=text)


def run(options: argparse.Namespace) -> dict[str, Any]:
    from puckbench.core.progress import Progress
    from puckbench.io.recordings.compressed_chunks import compressed_chunks
    from puckbench.puck import CodingOptions, compress

    coding = CodingOptions(effort=options.effort, key_every=options.key_every)
    summary = compress(options.recording, options.out, coding, Progress("byte"))
    chunks = compressed_chunks(options.recording)
    if chunks:
        _LOG.warning(
            "%s: %.0f %% of its bytes are chunks compressed by %s, which stay as they are, because "
            "another version of %s may not restore the same bytes; decompress the file first (%s)",
            options.recording,
            100 * sum(chunks.values()) / summary.bytes,
            *(2 * [" and ".join(chunks)]),
            "rosbag decompress" if options.recording.suffix == ".bag" else "mcap decompress",
        )
    elif not summary.packets:
        _LOG.warning(
            "%s: no data packets of a modelled sensor (Ouster's need the sensor's .json beside the "
            "capture): LZMA alone",
            options.recording,
        )
    return summary.as_json() | ({"compressed_chunks": chunks} if chunks else {})

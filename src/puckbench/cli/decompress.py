"""`puckbench decompress`: the recording of a file that `puckbench compress` wrote."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("stream", type=Path, help="file of `puckbench compress` (.puck)")
    parser.add_argument("out", type=Path, help="recording to write")
    parser.add_argument(
        "--trusted",
        action="store_true",
        help="restore also what is far larger than `compress` lets a file of this size become",
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Write the recording."""
    from puckbench.core.progress import Progress
    from puckbench.puck.recording import account_of, decompress

    account = decompress(options.stream, options.out, Progress("byte"), trusted=options.trusted)
    return account_of(account)

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("stream", type=Path, help="file of `puckbench compress` (.puck)")
    parser.add_argument("out", type=Path, help="recording to write")
    parser.add_argument(
        "--trusted",
        action="store_true",
        help="do not limit the size of the recording in proportion to that of the file",
    )


def run(options: argparse.Namespace) -> dict[str, Any]:
    from puckbench.core.progress import Progress
    from puckbench.puck import decompress

    summary = decompress(options.stream, options.out, Progress("byte"), trusted=options.trusted)
    return summary.as_json()

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("stream", type=Path, help="file of `puckbench compress` (.puck)")
    add("out", type=Path, help="recording to write")
    text = "do not limit the size of the recording in proportion to that of the file"
    add("--trusted", action="store_true", help=text)


def run(options: argparse.Namespace) -> dict[str, Any]:
    from puck import decompress
    from puckbench.core.progress import Progress

    summary = decompress(options.stream, options.out, Progress("byte"), trusted=options.trusted)
    return summary.as_json()

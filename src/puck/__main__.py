"""Command line: ``python -m puck compress IN OUT`` and ``python -m puck decompress IN OUT``."""

from __future__ import annotations

import argparse
import logging
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

from pointkit.errors import InputError
from pointkit.files import refusing_paths
from pointkit.terminal import print_answer
from puck import commands


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise InputError(message)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="python -m puck", description="Compress recordings of spinning LiDARs.")
    parsers = parser.add_subparsers(metavar="COMMAND", required=True)
    text = "compress a recording, so that every byte can be restored"
    compress = parsers.add_parser("compress", help=text, description=text)
    commands.add_compress_arguments(compress)
    compress.set_defaults(run=commands.run_compress)
    text = "restore a recording from a .puck file"
    decompress = parsers.add_parser("decompress", help=text, description=text)
    commands.add_decompress_arguments(decompress)
    decompress.set_defaults(run=commands.run_decompress)
    return parser


def main(words: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Parameters
    ----------
    words
        The arguments, starting with the name of the command; by default, those of the process.

    Returns
    -------
    int
        0 after success, 2 if the input is invalid (one line on standard error says why), and 130
        after an interrupt.
    """
    logging.basicConfig(format="puck: %(message)s")
    try:
        options = _parser().parse_args(words)
        with refusing_paths():
            answer = options.run(options)
        width = max(map(len, answer))
        lines = (f"{name:{width}}  {value}" for name, value in answer.items())
        print_answer("\n".join(lines), options.out)
    except InputError as error:
        return _fail(" ".join(str(error).split()), 2)
    except KeyboardInterrupt:
        return _fail("interrupted", 130)
    return 0


def _fail(message: str, status: int) -> int:
    print(f"puck: {message}", file=sys.stderr)  # noqa: T201
    return status


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.exit(main())

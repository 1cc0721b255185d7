"""The command line: one module per command, each with `arguments(parser)` and `run(options)`."""

from __future__ import annotations

import argparse
import importlib
import json
import logging
import os
import sys
from collections.abc import Container, Sequence
from pathlib import Path
from types import ModuleType
from typing import NoReturn

from puckbench import __version__
from puckbench.cli.answers import text_of
from puckbench.core.errors import InputError
from puckbench.core.files import unwritable

COMMANDS = {
    "run": "compare codecs on clouds, meshes and recordings of yours: a table and a report",
    "scene": "write a scene of a scene set as a mesh or cloud with its description",
    "scan": "scan a mesh with a virtual sensor: the table of all returns",
    "capture": "read a capture of a VLP-16 or Puck Hi-Res: the table of its returns",
    "export": "write a scan or a capture in the format of another tool",
    "compress": "store a recording of a spinning LiDAR in a small file, bit for bit",
    "decompress": "give back the recording of such a file",
    "residuals": "scan a wall and a floor: distances of the points to fitted planes",
    "calibrate": "estimate a range error model from residuals, real or virtual",
    "sample": "sample points at random on the surface of a mesh",
    "prepare": "crop, estimate normals and scale: a cloud ready for the codecs",
    "encode": "code a cloud with a codec at a rate",
    "decode": "decode a stream",
    "train": "train a learned codec on clouds: a set of weights with its model card",
    "evaluate": "measure a decoded cloud or a coded stream against its reference",
    "recovery": "compare a stream's geometric primitives with the labels of the scene",
    "wall": "scan a wall and a floor: the points, in the wall's frame",
    "table": "make a table of the sensor study",
    "figure": "draw a figure from the tables of results",
    "claims": "what a run says of the claims of the thesis",
    "reproduce": "list the thesis's figures and tables: made, or how to make them",
    "compare": "compare codecs of a run with reference results on the same clouds",
    "report": "write one HTML file with a run's figures, tables, curves and clouds",
    "codecs": "list the codecs: what each is for, and whether it can run here",
    "conformance": "try a G-PCC decoder on stored streams of the reference software",
    "datasets": "list the loaders of scene sets and their options",
    "data": "fetch the free data sets through the package managers",
    "completion": "print the script by which a shell completes this command line",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; 0, or 2 after a one-line message when the input cannot be used.

    An answer whose `failed` is not 0 gives 1.
    Interrupted by the user it ends with 130, as a shell's own commands do.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    _show_remarks()
    try:
        parser, name = _parser(given)
        options = parser.parse_args(given)
        answer = _run(name, options, parser)
        if isinstance(answer, str):
            _show(answer)
        elif answer is not None:
            _show(json.dumps(answer, allow_nan=False) if options.json else text_of(answer))
    except InputError as error:
        return _fail(str(error))
    except KeyboardInterrupt:
        return _fail("interrupted", status=130)
    return int(isinstance(answer, dict) and bool(answer.get("failed")))


class _Remarks(logging.Handler):
    """Prints each line of the log once on standard error."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._lines: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        line = " ".join(record.getMessage().split())
        if line not in self._lines:
            self._lines.add(line)
            print(f"puckbench: {line}", file=sys.stderr)  # noqa: T201


def _show_remarks() -> None:
    """Let this command print what readers remark on their input, by the log ``puckbench``."""
    log = logging.getLogger("puckbench")
    log.handlers = [other for other in log.handlers if not isinstance(other, _Remarks)]
    log.addHandler(_Remarks())


def _show(text: str) -> None:
    """Print; InputError when standard output cannot take it, silence when its reader has gone."""
    try:
        print(text)  # noqa: T201
        sys.stdout.flush()
    except OSError as error:
        # What is left would fail again when the interpreter ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            raise unwritable(Path("standard output"), error) from error


def _parser(given: Sequence[str]) -> tuple[argparse.ArgumentParser, str | None]:
    """The parser of the command asked for: the others' modules are not even imported."""
    name = next((word for word in given if not word.startswith("-")), None)
    parser = parser_of([name] if name in COMMANDS else [])
    if name is not None and name not in COMMANDS:
        from puckbench.core.models import among

        parser.error(f"unknown command '{name}'{among(name, COMMANDS)}")
    return parser, name


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, like any other of bad input."""

    def error(self, message: str) -> NoReturn:
        """InputError with the command's name."""
        command = self.prog.removeprefix("puckbench").strip()
        raise InputError(f"{command}: {message}" if command else message)


def parser_of(whole: Container[str]) -> argparse.ArgumentParser:
    """The parser of all commands, of which those in `whole` have their arguments too."""
    parser = _Parser(prog="puckbench", description=sys.modules["puckbench"].__doc__)
    parser.add_argument("--version", action="store_true", help="print the version")
    parser.add_argument(
        "-v", "--verbose", action="store_true", help="with --version: also what puckbench runs with"
    )
    commands = parser.add_subparsers(metavar="COMMAND")
    for command, text in COMMANDS.items():
        sub = commands.add_parser(command, help=text, description=text)
        if command in whole:
            _command(command).arguments(sub)
            sub.add_argument("--json", action="store_true", help="print one JSON object")
    return parser


def _command(name: str) -> ModuleType:
    return importlib.import_module(f"puckbench.cli.{name}")


def _run(
    name: str | None, options: argparse.Namespace, parser: argparse.ArgumentParser
) -> dict[str, object] | str | None:
    if name is None:
        return _version(options.verbose) if options.version else parser.format_help().rstrip()
    answer: dict[str, object] | str | None = _command(name).run(options)
    return answer


def _version(verbose: bool) -> str:
    if not verbose:
        return f"puckbench {__version__}"
    from puckbench.core.environment import installation

    return text_of({"puckbench": __version__, **installation()})


def _fail(message: str, status: int = 2) -> int:
    print(f"puckbench: {' '.join(message.split())}", file=sys.stderr)  # noqa: T201
    return status

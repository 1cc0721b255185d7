"""The command line of puckbench; `puckbench.cli.registry` lists its commands."""

from __future__ import annotations

import argparse
import json
import logging
import sys
from collections.abc import Container, Sequence
from typing import NoReturn

import puckbench
from pointkit.errors import InputError
from pointkit.files import refusing_paths
from pointkit.terminal import print_answer
from puckbench.cli.answers import text_of
from puckbench.cli.registry import Answer, command, help_texts
from puckbench.core.interrupts import interrupted_by_signals

_DESCRIPTION = (
    "A reproducible benchmark of point-cloud compression on virtual and real LiDAR scans."
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command of the command line.

    Parameters
    ----------
    arguments
        Words of the command line after ``puckbench``; by default, those of this process.

    Returns
    -------
    int
        Exit status: 0 after success, 1 if the command reports failed items (``failed`` in its
        answer is not 0), 2 if the input is invalid, and 130 after an interrupt (SIGINT, SIGTERM,
        SIGHUP).
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    _show_remarks()
    try:
        for word in words:
            _check_utf8(word)
        parser, name = _parser(words)
        options = parser.parse_args(words)
        with interrupted_by_signals(), refusing_paths():
            answer = _run(name, options, parser)
        if isinstance(answer, str):
            print_answer(answer)
        elif answer is not None:
            text = json.dumps(answer, allow_nan=False) if options.json else text_of(answer)
            print_answer(text, getattr(options, "out", None))
    except InputError as error:
        return _fail(str(error))
    except KeyboardInterrupt:
        return _fail("interrupted", status=130)
    return int(isinstance(answer, dict) and bool(answer.get("failed")))


def _check_utf8(word: str) -> None:
    try:
        word.encode()
    except UnicodeEncodeError as error:
        raise InputError(f"{word!a}: not in UTF-8: rename the file") from error


class _Remarks(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._lines: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        line = " ".join(record.getMessage().split())
        if line not in self._lines:
            self._lines.add(line)
            print(f"puckbench: {line}", file=sys.stderr)  # noqa: T201


def _show_remarks() -> None:
    remarks = _Remarks()
    for log in map(logging.getLogger, ("puckbench", "cloud_files", "puck")):
        log.handlers = [other for other in log.handlers if not isinstance(other, _Remarks)]
        log.addHandler(remarks)


def _parser(words: Sequence[str]) -> tuple[argparse.ArgumentParser, str | None]:
    """Return a parser for the words of a command line, and the command's name, or None."""
    name, texts = next((word for word in words if not word.startswith("-")), None), help_texts()
    parser = parser_of([name] if name in texts else [])
    if name is not None and name not in texts:
        from pointkit.errors import among

        parser.error(f"unknown command '{name}'{among(name, texts)}")
    return parser, name


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        name = self.prog.removeprefix("puckbench").strip()
        raise InputError(f"{name}: {message}" if name else message)


def parser_of(
    names: Container[str], parser_class: type[argparse.ArgumentParser] = _Parser
) -> argparse.ArgumentParser:
    """Return a parser of the command line.

    Parameters
    ----------
    names
        Names of the commands whose arguments the parser knows. It knows other commands only by name
        and help text, since their modules take time to import.
    parser_class
        Class of the parser.
    """
    parser = parser_class(prog="puckbench", description=_DESCRIPTION)
    parser.add_argument("--version", action="store_true", help="print the version")
    parser.add_argument(
        "-v",
        "--verbose",
        action="store_true",
        help="with --version: also the versions of Python and of the packages in use",
    )
    commands = parser.add_subparsers(metavar="COMMAND")
    for name, text in help_texts().items():
        sub = commands.add_parser(name, help=text, description=text)
        if name in names:
            command(name).arguments(sub)
            sub.add_argument("--json", action="store_true", help="print one JSON object")
    return parser


def _run(name: str | None, options: argparse.Namespace, parser: argparse.ArgumentParser) -> Answer:
    if name is None:
        return _version(options.verbose) if options.version else parser.format_help().rstrip()
    return command(name).run(options)


def _version(verbose: bool) -> str:
    if not verbose:
        return f"puckbench {puckbench.__version__}"
    from puckbench.core.environment import installation

    return text_of({"puckbench": puckbench.__version__, **installation()})


def _fail(message: str, status: int = 2) -> int:
    print(f"puckbench: {' '.join(message.split())}", file=sys.stderr)  # noqa: T201
    return status

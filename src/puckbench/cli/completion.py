from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

SHELLS = ("bash", "zsh", "fish")


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=SHELLS, help="shell whose completion script is printed")


def run(options: argparse.Namespace) -> str:
    import shtab

    from puckbench.cli import parser_of
    from puckbench.cli.registry import help_texts

    parser = parser_of(help_texts(), _CompletedParser)
    return str(shtab.complete(parser, options.shell)).rstrip()


class _CompletedParser(argparse.ArgumentParser):
    """A parser that tells the package shtab how the shell completes each argument.

    `Path` arguments are completed with files, those for plug-ins with the registered names.
    """

    def add_argument(self, *names: Any, **options: Any) -> argparse.Action:
        import shtab

        action = super().add_argument(*names, **options)
        if action.type is Path or action.dest in _FILES:
            action.complete = shtab.FILE  # type: ignore[attr-defined]  # as shtab documents
        elif action.choices is None and action.nargs != 0 and action.dest in _NAMES:
            action.choices = _NAMES[action.dest]()
        return action


def _codecs() -> list[str]:
    from puckbench.codecs.registry import codecs

    return list(codecs())


def _error_models() -> list[str]:
    from puckbench.lidar.errors import ERROR_MODELS

    return ERROR_MODELS.names()


def _figures() -> list[str]:
    from puckbench.figures.registry import FIGURES

    return FIGURES.names()


def _loaders() -> list[str]:
    from puckbench.datasets.registry import LOADERS

    return LOADERS.names()


def _sensors() -> list[str]:
    from puckbench.lidar.sensor import sensor_names

    return sensor_names()


def _sources() -> list[str]:
    from puckbench.datasets.sources import SOURCES

    return list(SOURCES)


def _studies() -> list[str]:
    from puckbench.report.reference_results import shipped_studies

    return shipped_studies()


def _tables() -> list[str]:
    from puckbench.metrics.table_registry import TABLES

    return TABLES.names()


_FILES = {"files", "start", "weights"}
"""Arguments, by their name, whose values may be files though they are not of the type `Path`."""

_NAMES: dict[str, Callable[[], list[str]]] = {
    "check": _loaders,
    "codec": _codecs,
    "codecs": _codecs,
    "errors": _error_models,
    "figure": _figures,
    "loader": _loaders,
    "model": _error_models,
    "names": _sources,
    "sensor": _sensors,
    "study": _studies,
    "table": _tables,
}
"""Arguments, by their name, whose values are names of a registry."""

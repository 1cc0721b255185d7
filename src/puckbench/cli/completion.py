from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path
from typing import Any

from pointkit.registry import Registry

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
    def add_argument(self, *names: Any, **options: Any) -> argparse.Action:
        import shtab

        action = super().add_argument(*names, **options)
        if action.type is Path or action.dest in _FILES:
            action.complete = shtab.FILE  # type: ignore[attr-defined]  # as shtab documents
        elif action.choices is None and action.nargs != 0 and action.dest in _NAMES:
            action.choices = _names(_NAMES[action.dest])
        return action


def _names(place: str) -> list[str]:
    module, _, name = place.partition(":")
    source = getattr(import_module(module), name)
    if isinstance(source, Registry):
        return source.names()
    return list(source() if callable(source) else source)


_FILES = {"files", "start", "weights"}
"""Names of arguments whose values may be files, although their type is not `Path`."""

_CODECS, _ERROR_MODELS = "puckbench.codecs.registry:codecs", "virtual_lidar.errors:ERROR_MODELS"
_LOADERS = "puckbench.scene_sets.registry:LOADERS"
_NAMES = {
    "again": _CODECS,
    "check": _LOADERS,
    "codec": _CODECS,
    "codecs": _CODECS,
    "errors": _ERROR_MODELS,
    "figure": "puckbench.figures.registry:FIGURES",
    "loader": _LOADERS,
    "model": _ERROR_MODELS,
    "names": "puckbench.scene_sets.sources:SOURCES",
    "sensor": "pointkit.lidar.sensor:sensor_names",
    "study": "puckbench.report.reference_results:shipped_studies",
    "table": "puckbench.tables.registry:TABLES",
}
"""Sources (``module:object``) of the names that an argument can take, by the argument's name."""

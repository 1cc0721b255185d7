"""`puckbench datasets`: the loaders of scene sets and their options."""

from __future__ import annotations

import argparse
from typing import Any

from puckbench.datasets.registry import REGISTRY, loader_options


def arguments(parser: argparse.ArgumentParser) -> None:
    """No arguments."""


def run(options: argparse.Namespace) -> dict[str, Any]:
    """One line (or JSON member) for each loader."""
    table = {name: loader_options(name) for name in REGISTRY}
    if options.json:
        return dict(table)
    return {
        name: ", ".join(f"{key}={value!r}" for key, value in o.items()) for name, o in table.items()
    }

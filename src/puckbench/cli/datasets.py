"""`puckbench datasets`: the loaders of scene sets and their options."""

from __future__ import annotations

import argparse
from dataclasses import MISSING, fields
from typing import Any

from puckbench.datasets.registry import REGISTRY
from puckbench.plugins import load_class


def arguments(parser: argparse.ArgumentParser) -> None:
    """No arguments."""


def run(options: argparse.Namespace) -> dict[str, Any]:
    """One line (or JSON member) for each loader: its options, and the defaults they have."""
    table = {name: _options(name) for name in REGISTRY}
    return table if options.json else {name: _line(found) for name, found in table.items()}


def _options(loader: str) -> dict[str, Any]:
    known = fields(load_class(REGISTRY[loader], f"loader {loader}"))
    return {item.name: "required" if item.default is MISSING else item.default for item in known}


def _line(options: dict[str, Any]) -> str:
    return ", ".join(f"{name}: {value}" for name, value in options.items())

"""`puckbench codecs`: the codecs, their rates, and whether they can run here."""

from __future__ import annotations

import argparse
from typing import Any

from puckbench.codecs.registry import codecs, open_codec


def arguments(parser: argparse.ArgumentParser) -> None:
    """No arguments."""


def run(options: argparse.Namespace) -> dict[str, Any]:
    """One line (or JSON member) for each codec."""
    table = {}
    for name in codecs():
        codec = open_codec(name)
        ok, why = codec.available()
        weights = sorted({codec.weights_of(rate) for rate in codec.rates} - {""}) if ok else []
        table[name] = {
            "available": ok,
            "why": why,
            "version": codec.version,
            "weights": weights,
            "rates": codec.rates,
        }
    return table if options.json else {name: _line(entry) for name, entry in table.items()}


def _line(entry: dict[str, Any]) -> str:
    state = "available" if entry["available"] else f"not available: {entry['why']}"
    rates = "; ".join(
        f"{name} " + ", ".join(f"{key} {value}" for key, value in values.items())
        for name, values in entry["rates"].items()
    )
    version = entry["version"]
    version = f"version {version}" if version.isdigit() else version
    about = [*filter(None, [version]), *(f"weights {weights}" for weights in entry["weights"])]
    return f"{state} ({', '.join(about)}); {rates}" if about else f"{state}; {rates}"

from __future__ import annotations

import argparse
from typing import Any

from pointkit.registry import trust
from puckbench.codecs.coding import why_not_here
from puckbench.codecs.rates import metric_rates, scaled_rates
from puckbench.codecs.registry import codecs, look, open_codec
from puckbench.codecs.weights_label import weights_label


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("codec", nargs="?", help="show all about this codec")


def run(options: argparse.Namespace) -> dict[str, Any]:
    trust([options.codec])
    table = {name: _entry(name) for name in ([options.codec] if options.codec else codecs())}
    if options.json:
        return table
    if options.codec:
        return {name: value for name, value in table[options.codec].items() if value}
    return {"codecs": {name: _row(entry) for name, entry in table.items()}}


def _entry(name: str) -> dict[str, Any]:
    codec = open_codec(name)
    why = why_not_here(codec)
    files = () if why else map(codec.weights, codec.rates)
    weights = sorted({weights_label(file) for file in files} - {""})
    return {
        "use": look(name).use,
        "available": not why,
        "why": why,
        "version": codec.version,
        "weights": weights,
        "rates": scaled_rates(codec.rates),
        "metric_rates": metric_rates(codec.rates),
    }


def _row(entry: dict[str, Any]) -> dict[str, str]:
    tables = [list(entry[key]) for key in ("rates", "metric_rates") if entry[key]]
    state = "" if entry["available"] else f" (not here: {entry['why']})"
    return {
        "rates": "; ".join(" to ".join(dict.fromkeys([rates[0], rates[-1]])) for rates in tables),
        "take it for": entry["use"] + state,
    }

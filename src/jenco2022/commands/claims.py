from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from jenco2022.sections import measured_parts
from pointkit.errors import InputError
from puckbench.cli.registry import COMMANDS


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("results", type=Path, help="folder of results, or a claims.csv")


@COMMANDS.register(
    "claims", arguments=arguments, help="show the verdicts of a run on the thesis's claims"
)
def run(options: argparse.Namespace) -> dict[str, Any]:
    from pointkit.tables import read_table

    path = options.results
    path = path if path.suffix else path / "tables" / "claims.csv"
    if not path.exists():
        raise InputError(f"{path}: no such file; a run makes it with the key `thesis: true`")
    table = read_table(path).astype(object)
    table = table.where(table.notna(), "")
    if missing := [name for name in ("number", "claim", "verdict", "here") if name not in table]:
        raise InputError(f"{path}: not a table of claims (no column {missing[0]!r})")
    rows = [
        {str(key): value for key, value in row.items()}
        for row in table.astype(str).to_dict("records")
    ]
    if options.json:
        return {"claims": rows}
    return {row["number"]: "\n".join(_lines(row)) for row in rows}


def _lines(row: dict[str, str]) -> Iterator[str]:
    yield from _wrapped("", f"{row['claim']} ({row.get('section', '')})")
    yield from _wrapped("    ", row["verdict"].upper() if row["here"] else row["verdict"])
    for part in measured_parts(row["here"]):
        yield from _wrapped("    - ", part)
    labels = {"not_tested": "not tested", "thesis": "thesis", "thesis_verdict": "by its medians"}
    for name, label in labels.items():
        if row.get(name) and (name != "not_tested" or row["here"]):
            yield from _wrapped("    ", f"{label}: {row[name]}")
    if row.get("figure"):
        yield from _wrapped("    ", f"figure: {row['figure']}")


def _wrapped(indent: str, text: str) -> list[str]:
    import textwrap

    next_indent = " " * (len(indent) or 4)
    return textwrap.wrap(text, 96, initial_indent=indent, subsequent_indent=next_indent)

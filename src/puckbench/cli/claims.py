"""`puckbench claims`: the thesis's claims and what a run says of them, for a terminal."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from puckbench.core.errors import InputError


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("results", type=Path, help="folder of results, or a claims.csv")
    parser.add_argument("--claim", type=int, action="append", help="only the claim of this number")


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Read the table of claims; its rows as JSON, or as text under their numbers."""
    from puckbench.io.tables import read_table

    given = options.results
    path = given if given.suffix else given / "tables" / "claims.csv"
    table = read_table(path).astype(object)
    table = table.where(table.notna(), "")
    if missing := [name for name in ("number", "claim", "verdict", "here") if name not in table]:
        raise InputError(f"{path}: not a table of claims (no column {missing[0]!r})")
    rows = [
        {str(key): value for key, value in row.items()}
        for row in table.astype(str).to_dict("records")
        if not options.claim or int(row["number"]) in options.claim
    ]
    if unknown := sorted({*(options.claim or ())} - {int(row["number"]) for row in rows}):
        raise InputError(f"--claim: {path} has no claim {unknown[0]}")
    if options.json:
        return {"claims": rows}
    return {row["number"]: "\n".join(_lines(row)) for row in rows}


def _lines(row: dict[str, str]) -> Iterator[str]:
    """A claim's row in lines of a terminal's width."""
    yield from _wrapped("", f"{row['claim']} ({row.get('section', '')})")
    yield from _wrapped("    ", row["verdict"].upper() if row["here"] else row["verdict"])
    for part in filter(None, row["here"].split("; ")):
        yield from _wrapped("    - ", part)
    shown = {"not_tested": "not tested", "thesis": "thesis", "thesis_verdict": "by its medians"}
    for name, title in shown.items():
        if row.get(name) and (name != "not_tested" or row["here"]):
            yield from _wrapped("    ", f"{title}: {row[name]}")
    if row.get("figure"):
        yield from _wrapped("    ", f"figure: {row['figure']}")


def _wrapped(lead: str, text: str) -> list[str]:
    import textwrap

    rest = " " * (len(lead) or 4)
    return textwrap.wrap(text, 96, initial_indent=lead, subsequent_indent=rest)

"""Comparison of two results folders, without times.

Tables are compared without columns of time and memory, other files byte by byte. Logs, the report
and figures of times are ignored.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from puckbench.core.archives import SUFFIX as ARCHIVE
from puckbench.core.archives import read_archive
from puckbench.results.sameness import is_timed, timeless
from puckbench.tables.registry import table_entries

_TABLE_FOLDERS = {"tables", "first_look", "metrics", "recovery"}
_LEFT_OUT = re.compile(
    r"^(logs/.*|report\.html|tables/.*\.tex|\.lock|\.digests\.json|reference\.parquet"
    r"|(figures|first_look)/(fig_6_[589]|medians_per_rate|encoding_time|decoding_time)\.\w+"
    r"|(.*/)?\.snakemake_timestamp)$"
)
"""Files with times: logs, report, reference results and three figures (with two names each); LaTeX
tables, whose values are those of the CSV files; and the files in which Snakemake notes times."""


def differences(folder: Path, reference: Path, finished: bool = True) -> list[str]:
    """Return a line for each file that differs.

    If `finished` is false, files that are only in `reference` are ignored.
    """
    names, reference_names = set(compared(folder)), set(compared(reference))
    lines = [f"{name}: only in {folder}" for name in sorted(names - reference_names)]
    if finished:
        lines += [f"{name}: only in {reference}" for name in sorted(reference_names - names)]
    common = sorted(names & reference_names)
    return lines + [
        f"{name}: differs" for name in common if not same(folder / name, reference / name)
    ]


def after_a_kill(folder: Path, reference: Path) -> list[str]:
    lines = differences(folder, reference, finished=False)
    return [line for line in lines if ".tmp" not in line]


def compared(folder: Path) -> Iterator[str]:
    for path in folder.rglob("*"):
        name = path.relative_to(folder).as_posix()
        if path.is_file() and not _LEFT_OUT.match(name):
            yield name


def same(first: Path, second: Path) -> bool:
    return bool(_content(first) == _content(second))


def _content(path: Path) -> Any:
    if path.suffix in {".csv", ".parquet"} and _TABLE_FOLDERS.intersection(path.parts):
        entry = table_entries().get(path.stem) if path.parent.name == "tables" else None
        return timeless(_table(path), entry.timed if entry else {})
    if path.suffix == ARCHIVE:
        return {name: _member(name, data) for name, data in read_archive(path).items()}
    return _member(path.name, path.read_bytes())


def _member(name: str, data: bytes) -> Any:
    return _timeless(json.loads(data)) if name.endswith(".json") else data


def _table(path: Path) -> list[list[str]]:
    if path.suffix == ".csv":
        with path.open(newline="", encoding="utf-8") as stream:
            return list(csv.reader(stream))
    import pandas as pd

    table = pd.read_parquet(path)
    rows = table.to_numpy(object)
    return [[*map(str, table)], *([_text(cell) for cell in row] for row in rows)]


def _text(cell: Any) -> str:
    return cell if isinstance(cell, str) else repr(cell)


def _timeless(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _timeless(item) for key, item in value.items() if not is_timed(key)}
    return value

"""Whether two results folders hold the same bytes, times aside.

    python benchmarks/same_results.py RESULTS OTHER_RESULTS

Compares every file but logs and the report page: tables and rows without their columns of time and
memory, everything else byte by byte. Prints what differs; exit status 1 when anything does.
"""

from __future__ import annotations

import csv
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

TIMES = re.compile(r"^(en|de)code_(s|peak_mib)(_\w+)?$")
"""Columns that no two runs have alike."""
ABOUT_TIMES = "Times grow with the rate"
"""Words of the one claim of `claims.csv` that is about them."""
LEFT_OUT = re.compile(r"^(logs/.*|report\.html|\.lock)$")


def differences(folder: Path, reference: Path, finished: bool = True) -> list[str]:
    """What is not alike; of an unfinished folder, files that it lacks are none of it."""
    here, there = set(_files(folder)), set(_files(reference))
    found = [f"{name}: only in {folder}" for name in sorted(here - there)]
    if finished:
        found += [f"{name}: only in {reference}" for name in sorted(there - here)]
    both = sorted(here & there)
    return found + [
        f"{name}: differs" for name in both if not same(folder / name, reference / name)
    ]


def after_a_kill(folder: Path, reference: Path) -> list[str]:
    """What is not alike of what a killed run left; temporary files are for the next to remove."""
    found = differences(folder, reference, finished=False)
    return [line for line in found if ".tmp" not in line]


def _files(folder: Path) -> Iterator[str]:
    for path in folder.rglob("*"):
        name = path.relative_to(folder).as_posix()
        if path.is_file() and not LEFT_OUT.match(name):
            yield name


def same(first: Path, second: Path) -> bool:
    """Whether two files are alike; InputError or ValueError for one that cannot be read."""
    return bool(_content(first) == _content(second))


def _content(path: Path) -> Any:
    if path.suffix in {".csv", ".parquet"} and "tables" in path.parts:
        return _without_times(_table(path))
    if path.suffix == ".json":
        return _timeless(json.loads(path.read_text(encoding="utf-8")))
    return path.read_bytes()


def _table(path: Path) -> list[list[str]]:
    """The names of the columns and the cells of every row, as text, in which nan equals nan."""
    if path.suffix == ".csv":
        with path.open(newline="", encoding="utf-8") as stream:
            return list(csv.reader(stream))
    import pandas as pd

    table = pd.read_parquet(path)
    return [[*map(str, table)], *([repr(cell) for cell in row] for row in table.to_numpy(object))]


def _without_times(rows: list[list[str]]) -> list[list[str]]:
    kept = [at for at, name in enumerate(rows[0]) if not TIMES.match(name)]
    compared = [row for row in rows if not any(ABOUT_TIMES in cell for cell in row)]
    return [[row[at] for at in kept] for row in compared]


def _timeless(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _timeless(item) for key, item in value.items() if not TIMES.match(key)}
    return value


def main() -> None:
    folder, reference = (Path(word) for word in sys.argv[1:3])
    found = differences(folder, reference)
    print("\n".join(found) or f"the same, times aside: {len(list(_files(folder)))} files")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()

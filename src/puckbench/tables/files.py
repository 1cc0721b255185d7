from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointkit.errors import InputError, among, closest
from pointkit.files import write_bytes

if TYPE_CHECKING:
    import pandas as pd

TABLES_FOLDER = "tables"
"""Name of the folder with tables, in a results folder."""


def write_result(
    table: pd.DataFrame,
    columns: Path | None,
    *paths: Path,
    wanted: Sequence[str] = (),
    usual: Sequence[str] = (),
    titles: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Write a table to several files, and return the number of rows as ``rows``.

    Parameters
    ----------
    table
        The table.
    columns
        If set, file to which a table with the meanings of the columns is written.
    paths
        Files to write, in the formats of their suffixes (``.csv``, ``.parquet``, ``.tex``).
    wanted
        Columns to write, with their intervals; by default, all. LaTeX shows some: `wanted` and
        `usual` are those of `puckbench.tables.latex.paper_columns`.
    titles
        Titles of codecs, for LaTeX.
    """
    from pointkit.tables import write_table
    from puckbench.tables.column_dictionary import column_dictionary
    from puckbench.tables.latex import latex_table, paper_columns, with_intervals

    shown = paper_columns(table, wanted, usual)
    kept = table[with_intervals(shown, table)] if wanted else table
    write_table(kept, *(path for path in paths if path.suffix != ".tex"))
    for path in paths:
        if path.suffix == ".tex":
            write_bytes(path, latex_table(table, shown, titles).encode())
    if columns is not None:
        write_table(column_dictionary(table), columns)
    return {"rows": len(table)}


def result_file(results: Path, table: str) -> Path:
    """Return the path of a table in a results folder, which need not exist."""
    return results / TABLES_FOLDER / f"{table}.parquet"


def read_result(results: Path, table: str) -> pd.DataFrame:
    """Read a table of a finished run from its results folder.

    Raises InputError, which suggests a similar name, if there is no such table.
    """
    from pointkit.tables import read_table

    path = result_file(results, table)
    if not path.exists():
        names = sorted(file.stem for file in path.parent.glob("*.parquet"))
        near = closest(table, names) or among(table, names)
        raise InputError(f"{path.parent}: no table '{table}'{near}")
    return read_table(path)

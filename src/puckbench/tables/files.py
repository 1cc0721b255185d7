from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointkit.files import write_bytes

if TYPE_CHECKING:
    import pandas as pd


def write_result(table: pd.DataFrame, columns: Path | None, *paths: Path) -> dict[str, Any]:
    """Write a table to several files, and return the number of rows as ``rows``.

    Parameters
    ----------
    table
        The table.
    columns
        If set, file to which a table with the meanings of the columns is written.
    paths
        Files to write, in the formats of their suffixes (``.csv``, ``.parquet``, ``.tex``).
    """
    from pointkit.tables import write_table
    from puckbench.tables.column_dictionary import column_dictionary
    from puckbench.tables.latex import latex_table

    write_table(table, *(path for path in paths if path.suffix != ".tex"))
    for path in paths:
        if path.suffix == ".tex":
            write_bytes(path, latex_table(table).encode())
    if columns is not None:
        write_table(column_dictionary(table), columns)
    return {"rows": len(table)}
